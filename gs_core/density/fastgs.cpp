// SPDX-License-Identifier: Apache-2.0
// The method "fastgs": a Gaussian grows where several photos show an error, opacities are capped
// after each refinement, and faint Gaussians are pruned late.                             FastGS
//
// Source: the code of March 2026, github.com/fastgs/FastGS, its base setting; the thresholds that it
// sets for each scene are the lowest of their range here. What differs: clones and
// splits have the same gradient threshold; every faint Gaussian is pruned, not a random half; none is
// pruned by the score.
#include "gs_core/density/growth_method.h"

namespace gs {
namespace {

constexpr int kPhotos = 10;
constexpr float kMaskError = 0.1f;     // of the range of errors of a photo
constexpr float kPixels = 6;           // in the mask, of a photo, in the mean
constexpr float kSmallScale = 0.001f;  // of the extent
constexpr float kOpacityCap = 0.8f;
constexpr float kLateOpacity = 0.1f;

}  // namespace

GrowthMethod fastgs_method() {
  GrowthMethod method;
  method.score = GrowthScore::mask;
  method.score_photos = kPhotos;
  method.mask_error = kMaskError;
  method.score_threshold = kPixels;
  method.small_scale = kSmallScale;
  method.opacity_cap = kOpacityCap;
  method.late_prune_opacity = kLateOpacity;
  return method;
}

}  // namespace gs
