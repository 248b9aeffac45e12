// SPDX-License-Identifier: Apache-2.0
// gemsplat bench --blenders: every blender of a GPU under every kind of tile bounds, how fast it is and how far its pictures
// are from those of the fp32 blender.
#pragma once

#include <string>
#include <vector>

#include "gs_app/checks/benchmark.h"

namespace gs {

/// One combination at one scale, over all views.
struct BlenderFigures {
  std::string bounds;   // exact, box, square
  std::string blender;  // simt, gemm, gemm half
  double scale = 1;
  int width = 0, height = 0;
  double instances = 0;     // of a view, mean
  double ms_per_frame = 0, blend_ms = 0;
  // Against simt under the same bounds:
  double psnr = 0;          // infinite where equal
  double largest = 0;       // difference of a channel
  std::size_t pixels = 0;   // of all views
  std::size_t apart = 0;    // with a channel that differs by more than kBlendersAgree
  std::size_t unexplained = 0;  // of these, as far from the equations in double, and not at a borderline (kBorderline)
  double borderline = 0;        // of those, at most
};

inline constexpr double kBlendersAgree = 1e-4;
/// A pixel is at a borderline where so much of one fragment's alpha, relative, decides whether a fragment is blended: rounding
/// may, too. An almost opaque fragment decides about the light behind it with little of its own.
inline constexpr double kBorderline = 1e-5;

/// All combinations at each of the plan's scales. The backend times its stages.
std::vector<BlenderFigures> compare_blenders(Backend& backend, TrainingModel& model,
                                             const std::vector<View>& views,
                                             const RenderSettings& settings,
                                             const BenchmarkPlan& plan);

}  // namespace gs
