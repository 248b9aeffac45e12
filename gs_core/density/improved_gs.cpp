// SPDX-License-Identifier: Apache-2.0
// The method "improved_gs": Gaussians are drawn in proportion to the edges that they show, and are
// split along the longest axis; after a reset, those that stay the faintest go.      Improved-GS
//
// Source: the code of November 2025, github.com/XiaoBin2001/Improved-GS. Its budget,
// density.max_gaussians here, is 3 million outdoors and 1 to 1.5 million indoors. What differs: edges
// are weighted by the blending weight; nothing grows in the steps of the recovery prune, nor by its
// gradient once the window is over.
#include "gs_core/density/growth_method.h"

namespace gs {
namespace {

constexpr int kPhotos = 10;
constexpr float kOffset = 1.35f;   // standard deviations of the longest axis
constexpr float kAlong = 0.55f;    // factor of the longest scale
constexpr float kAcross = 0.893f;  // factor of the other scales
constexpr float kChildOpacity = 0.6f;
constexpr float kLoweredOpacity = 0.05f;
constexpr float kRecoveryShare = 0.2f;
constexpr int kRecoveryAfter = 300;   // steps; as many in a short run
constexpr int kRecoveryUntil = 6000;  // the second reset

}  // namespace

GrowthMethod improved_gs_method() {
  GrowthMethod method;
  method.score = GrowthScore::edge;
  method.score_photos = kPhotos;
  method.absolute_gradient = true;
  method.select = GrowthSelection::race;
  method.curve = GrowthCurve::root;
  method.small_scale = 0;  // no Gaussian is cloned
  method.split = {SplitPlacement::axis, kOffset, kAlong, kAcross, false, kChildOpacity};
  method.opacity.amount = kLoweredOpacity;
  method.recovery_prune = kRecoveryShare;
  method.recovery_after = kRecoveryAfter;
  method.recovery_until = kRecoveryUntil;
  return method;
}

}  // namespace gs
