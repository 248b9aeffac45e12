// SPDX-License-Identifier: Apache-2.0
// `gemsplat selftest`: checks that this build computes correctly on this machine. It compares
// gradients with central differences, and a GPU with the CPU, on small generated scenes.
#pragma once

#include <string>
#include <vector>

#include "gs_train/backend.h"

namespace gs {

/// The agreement of one kind of numbers with the expected ones, in the worst of all scenes.
/// Differences are relative to the root mean square of the expected numbers.
struct SelfCheck {
  std::string what;
  std::size_t numbers = 0;  // in all scenes
  double largest = 0;       // largest difference
  // Root mean square of the differences; infinite if numbers are missing or not finite.
  double rms = 0;
  double tolerance = 0;  // of rms
  std::string scene;     // the scene with the largest rms

  bool agrees() const { return rms <= tolerance; }
};

/// Compares the scalar renderer's gradients of every learned quantity with central differences of
/// its pictures.
std::vector<SelfCheck> gradient_checks();

/// Compares every stage of `device` with the scalar backend: splats, tile lists, pictures,
/// gradients, loss, and a fused training step. For tile lists, `rms` is the share of instances that
/// differ.
std::vector<SelfCheck> parity_checks(Backend& device);

}  // namespace gs
