// SPDX-License-Identifier: Apache-2.0
// `gemsplat info`: describes trained Gaussians in numbers, and points out what looks wrong.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/gaussians.h"

namespace gs {

/// Something that looks wrong: a key for machines, how many Gaussians show it, a sentence for
/// people.
struct Suspicion {
  std::string key;
  std::size_t count = 0;
  std::string sentence;
};

/// Bounds, sizes and shares are of the Gaussians without NaN or infinity; 0 where there are none.
struct ModelInfo {
  std::size_t count = 0;
  int sh_degree = 0;
  bool antialiased = false;
  bool had_filter_3d = false;        // its PLY; scales and opacities hold that filter now
  std::size_t bytes = 0;             // in memory
  Vec3f min{0}, max{0};              // of the means, world units
  Vec3f inner_min{0}, inner_max{0};  // their 1st and 99th percentile on each axis, world units
  float median_scale = 0;            // of the geometric mean of the three scales, world units
  float faint_share = 0;             // opacity below 1/255: never drawn
  float thin_share = 0;              // opacity below 0.05, the faint ones among them
  float solid_share = 0;             // opacity above 0.9
  bool has_time = false;             // Gaussians in space and time
  float median_time_scale = 0;       // of those, in durations of the scene
  std::vector<Suspicion> suspicions;
};

/// Looks at every Gaussian; never throws. The caller, who knows the file, sets `had_filter_3d`.
ModelInfo inspect(const GaussianModel& model);

/// Whether the file is a PLY with Mip-Splatting's 3D filter (ply/mip_filter.h).
bool is_ply_with_filter_3d(const std::filesystem::path& file);

/// The numbers and then the suspicions, for people: one line each.
std::string describe(const ModelInfo& info);

/// The same as a JSON object on one line; suspicions become {"key": count, ...}.
std::string to_json_text(const ModelInfo& info);

}  // namespace gs
