// SPDX-License-Identifier: Apache-2.0
// `gemsplat bench --blenders`: the speed of each blender of a GPU with each kind of tile bounds,
// and the differences between its pictures and those of the fp32 blender (simt).
#pragma once

#include <string>
#include <vector>

#include "gs_app/checks/benchmark.h"

namespace gs {

/// One combination at one scale, over all views.
struct BlenderFigures {
  std::string bounds;   // exact, box, square
  std::string blender;  // simt, gemm
  double scale = 1;
  int width = 0, height = 0;
  double instances = 0;  // of a view, mean
  double ms_per_frame = 0, blend_ms = 0;
  // Compared with simt with the same bounds:
  double psnr = 0;         // infinite if the pictures are equal
  double largest = 0;      // largest difference of a channel
  std::size_t pixels = 0;  // of all views
  std::size_t apart = 0;   // pixels with a channel that differs by more than kBlendersAgree
  // Of these, pixels whose difference rounding does not explain (kBorderline)
  std::size_t unexplained = 0;
  double borderline = 0;  // the largest margin (see kBorderline) of these
};

inline constexpr double kBlendersAgree = 1e-4;
/// A difference is explained by rounding if a relative change of one fragment's alpha by less than
/// this would carry some fragment over a threshold (alpha >= 1/255, or transmittance >= 1e-4). The
/// least such change is the margin of the pixel. A difference is also explained if the blender
/// agrees with the equations in double.
inline constexpr double kBorderline = 1e-5;

/// Measures all combinations at each of the plan's scales. The backend must time its stages.
std::vector<BlenderFigures> compare_blenders(Backend& backend, TrainingModel& model,
                                             const std::vector<View>& views,
                                             const RenderSettings& settings,
                                             const BenchmarkPlan& plan);

}  // namespace gs
