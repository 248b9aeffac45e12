// SPDX-License-Identifier: Apache-2.0
// Does this build compute what it should on this machine? Gradients against slopes, and a GPU against the CPU, on
// small generated scenes: what `gemsplat selftest` shows.
#pragma once

#include <string>
#include <vector>

#include "gs_train/backend.h"

namespace gs {

/// How closely numbers agree with those expected, in the worst of all scenes. Differences are relative to the root
/// mean square of the numbers expected.
struct SelfCheck {
  std::string what;
  std::size_t numbers = 0;  // in all scenes
  double largest = 0;       // difference
  double rms = 0;           // difference, root mean square; infinite where numbers are missing or not finite
  double tolerance = 0;     // of the latter
  std::string scene;        // where that was worst

  bool agrees() const { return rms <= tolerance; }
};

/// Gradients of the scalar renderer by every learned quantity against central differences of its pictures.
std::vector<SelfCheck> gradient_checks();

/// Every stage of `device` against the scalar backend: splats, tile lists, pictures, gradients, loss, and a fused
/// training step. Of tile lists, `rms` is the share of instances that differ.
std::vector<SelfCheck> parity_checks(Backend& device);

}  // namespace gs
