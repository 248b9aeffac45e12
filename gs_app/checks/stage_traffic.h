// SPDX-License-Identifier: Apache-2.0
// The bytes that each memory-bound stage must read and write, independent of its kernels. `gemsplat
// bench` divides them by the stage's time, and compares the bandwidth with that of plain copies.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "gs_core/math/update/moment_storage.h"

namespace gs {

/// The size of the work on one view.
struct Workload {
  double gaussians = 0;       // N
  double visible = 0;         // V  Gaussians that the view sees
  double instances = 0;       // I
  double most_instances = 0;  // of any view
  double longest_list = 0;    // instances in the fullest tile
  double pixels = 0;          // P
  double tiles = 0;
  int sh_degree = 3;
  bool is_packed = false;   // stage 1 reads a packed model (Renderer::pack)
  double splat_bytes = 48;  // one splat
  MomentStorage moments = MomentStorage::floats;
};

/// Bytes that one run of a stage of the CUDA backend reads and writes. Nothing for the blending
/// stages, which are limited by arithmetic, and for unknown names.
std::optional<double> stage_bytes(const std::string& stage, const Workload& workload);

}  // namespace gs
