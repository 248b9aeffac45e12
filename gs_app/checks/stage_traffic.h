// SPDX-License-Identifier: Apache-2.0
// The bytes that each memory-bound stage has to move, whatever its kernels look like: what its time is held against.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace gs {

/// What one view asks of the stages.
struct Workload {
  double gaussians = 0;  // N
  double visible = 0;    // V  of them
  double instances = 0;  // I
  double longest_list = 0;  // instances of the fullest tile
  double pixels = 0;     // P
  double tiles = 0;
  int sh_degree = 3;
};

/// Bytes read and written by one run of a stage of the CUDA backend, by its name; nothing for the blending stages,
/// which arithmetic limits, and for names that are not known.
std::optional<double> stage_bytes(const std::string& stage, const Workload& workload);

}  // namespace gs
