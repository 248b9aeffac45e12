// SPDX-License-Identifier: Apache-2.0
// The method "growth", which the defaults use: Gaussians grow where the pixels of a photo disagree
// about their opacity, drawn as in LiteGS, and are split along the longest axis as in Improved-GS.
// The number rises evenly to density.max_gaussians.
//
// Measured part by part in docs/lab/2026-11-density.md and 2026-11-defaults.md.
#include "gs_core/density/growth_method.h"

namespace gs {
namespace {

constexpr float kMostGrowth = 1;  // of the count: a short run from few points doubles it at first
constexpr float kOffset = 1.35f, kAlong = 0.55f, kAcross = 0.893f;  // Improved-GS
constexpr float kChildOpacity = 0.7f;       // of the parent's; Improved-GS has 0.6
constexpr float kLeastHalved = 1.0f / 128;  // LiteGS

}  // namespace

GrowthMethod default_method() {
  GrowthMethod method;
  method.score = GrowthScore::force;
  method.window = StatisticsWindow::epoch;
  method.select = GrowthSelection::race;
  method.curve = GrowthCurve::linear;
  method.most_growth = kMostGrowth;
  method.split = {SplitPlacement::axis, kOffset, kAlong, kAcross, false, kChildOpacity};
  method.opacity = {OpacityPolicy::halve, kLeastHalved, MomentClearing::all};
  return method;
}

}  // namespace gs
