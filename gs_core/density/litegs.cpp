// SPDX-License-Identifier: Apache-2.0
// The method "litegs": Gaussians are drawn in proportion to how much their pixels disagree about
// their opacity, every second epoch, and what no photo shows goes.                        LiteGS
//
// Source: the code of March 2026, github.com/MooreThreads/LiteGS. What differs: the score is that of
// single pixels, where theirs adds up the two of a thread; opacities are halved after a number of
// steps, not of epochs.
#include "gs_core/density/growth_method.h"

namespace gs {
namespace {

constexpr int kEpochs = 2;  // between two refinements
constexpr float kLeastHalved = 1.0f / 128;

}  // namespace

GrowthMethod litegs_method() {
  GrowthMethod method;
  method.score = GrowthScore::force;
  method.window = StatisticsWindow::epoch;
  method.every_epochs = kEpochs;
  method.select = GrowthSelection::race;
  method.curve = GrowthCurve::linear;
  method.split.keeps_parent = true;
  method.opacity = {OpacityPolicy::halve, kLeastHalved, MomentClearing::all};
  method.prune_unseen = true;
  return method;
}

}  // namespace gs
