// SPDX-License-Identifier: Apache-2.0
// Stage 9: the rules of adaptive density control, for one Gaussian at a time.
//                                                                   Kerbl et al. 2023, Sec. 5.2
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/math/density/region.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/types.h"

namespace gs {

/// The thresholds of one refinement.
struct AdaptiveRules {
  float gradient_threshold;  // of the mean NDC-scaled image-plane gradient
  float small_scale;    // world units; a growing Gaussian up to it is cloned, a larger one split
  float prune_opacity;  // below it a Gaussian goes
  float prune_scale;    // world units; above it a Gaussian goes; infinity: none does
  std::int64_t max_gaussians;  // no growth beyond; 0: no cap
  Region region = {};          // Gaussians outside of it do not grow
};

/// The statistic that density control averages: the length of the image-plane gradient in units of
/// half the picture.   loss per NDC unit
GS_HD float screen_gradient_norm(const Vec2f& dL_dmean2d, int width, int height) {
  using std::sqrt;
  const Vec2f ndc = 0.5f * Vec2f(dL_dmean2d.x * float(width), dL_dmean2d.y * float(height));
  return sqrt(inner(ndc, ndc));
}

/// True if the mean gradient over the visible steps is large enough for growth.
GS_HD bool wants_growth(float visits, float gradient_norm, float threshold) {
  return gradient_norm >= threshold * max_of(visits, 1.0f);
}

GS_HD float largest(const Vec3f& v) { return max_of(max_of(v.x, v.y), v.z); }

/// True if the Gaussian is too small to split, and is cloned instead.
GS_HD bool is_small(const Vec3f& log_scale, float small_scale) {
  using std::log;
  return largest(log_scale) <= log(small_scale);
}

/// Center of one half of a split: a draw from the Gaussian itself.
///
/// normal  three independent standard normal numbers
GS_HD Vec3f split_mean(const Vec3f& mean, const Vec3f& log_scale, const Quatf& rotation,
                       const Vec3f& normal) {
  using std::exp;
  const Vec3f local{exp(log_scale.x) * normal.x, exp(log_scale.y) * normal.y,
                    exp(log_scale.z) * normal.z};
  return mean + multiply(rotation_matrix(rotation), local);
}
/// Log scale of both halves.
GS_HD Vec3f split_log_scale(const Vec3f& log_scale) {
  using std::log;
  return log_scale - Vec3f(log(kSplitScaleDivisor));
}

/// True if the Gaussian can never be visible: transparent, without a rotation, or not finite.
GS_HD bool is_invisible(const Vec3f& mean, const Vec3f& log_scale, const Quatf& rotation,
                        float logit_opacity, float min_opacity) {
  return !(sigmoid(logit_opacity) >= min_opacity) || is_degenerate(rotation) || !is_finite(mean) ||
         !is_finite(log_scale);
}

/// True if a refinement removes the Gaussian: it cannot be visible, or it is too large.
GS_HD bool is_pruned(const Vec3f& mean, const Vec3f& log_scale, const Quatf& rotation,
                     float logit_opacity, const AdaptiveRules& rules) {
  using std::exp;
  return is_invisible(mean, log_scale, rotation, logit_opacity, rules.prune_opacity) ||
         exp(largest(log_scale)) > rules.prune_scale;
}

}  // namespace gs
