// SPDX-License-Identifier: Apache-2.0
// Stage 9 for scenes that move, row by row and for both backends: a Gaussian in space and time that
// hardly changes during the scene becomes a static one, which is drawn as in 3D (math/spacetime.h).
#pragma once

#include <algorithm>

#include "gs_core/gaussians.h"
#include "gs_core/geometry/symmetric_eigen.h"
#include "gs_core/math/quaternion.h"
#include "gs_core/math/spacetime_color.h"
#include "gs_train/training_model.h"

namespace gs {

/// The 3D Gaussian of the scene's middle, and whether it stands for the other moments, too.
struct StaticGaussian {
  bool is_near = false;  // false: everything else is undefined
  Vec3d mean, log_scale;
  Quat<double> rotation;
  double logit_opacity;
};

/// Conditions a Gaussian in space and time on t = 1/2. The result is near the Gaussian at all times
/// of the scene, 0 to 1, if
///
///   sqrt(S_tt) > T 2 max(mu_t, 1 - mu_t)                       its opacity stays nearly the same
///   sum_k (a_k . v)^2 / max(s_k, 0.1 s_max)^2 < 0.25^2         it moves less than 0.25 of its size
///
/// T is `least_time_scale`; a Gaussian with its mean in the middle of the scene must have a larger
/// standard deviation in time, and one with its mean at an end twice as large a one. Its opacity then
/// changes by exp(-1 / (8 T^2)) at most: by 3 % for T = 2. v is the velocity, a_k and s_k are the
/// axes and scales of the conditioned covariance.   Scales in durations and world units
GS_HD StaticGaussian static_gaussian(const SpacetimeShape<double>& shape, double least_time_scale) {
  using std::log;
  using std::sqrt;
  const SpacetimeCovariance<double> S = covariance(shape);
  const double farthest = max_of(shape.time_mean, 1 - shape.time_mean);
  StaticGaussian result;
  // Comparisons are false for NaN; log() is finite below.
  if (!(S.time < 1e30 && sqrt(S.time) > 2 * least_time_scale * farthest)) return result;
  const Moment<double> moment = condition(S, 0.5 - shape.time_mean);
  const SymmetricEigen axes = symmetric_eigen(moment.covariance);
  const Vec3d v = velocity(S);
  const Mat3<double>& R = axes.R;
  const Vec3d along = R.row0 * v.x + R.row1 * v.y + R.row2 * v.z;
  const double largest = max_of(max_of(axes.value.x, axes.value.y), axes.value.z);
  const double least = kStaticLeastAxis * kStaticLeastAxis * largest;
  double way = 0;  // squared, in own sizes
  for (int k = 0; k < 3; ++k) {
    way += along[k] * along[k] / max_of(axes.value[k], least);
    // A variance that rounding has made flat or negative keeps a share of the largest.
    result.log_scale[k] = 0.5 * log(max_of(axes.value[k], 1e-12 * largest));
  }
  result.mean = shape.mean + moment.shift;
  result.rotation = quaternion_of(R);
  result.logit_opacity = logit(sigmoid(shape.logit_opacity) * moment.marginal);
  const double sum =
      inner(result.mean, result.mean) + result.logit_opacity + way + shape.log_time_scale;
  result.is_near = way < kStaticWay * kStaticWay && largest > 0 && sum - sum == 0;
  return result;
}

/// Whether the color of a Gaussian changes by little during the scene, 0 to 1: each channel by
/// kStaticColorChange at most.
GS_HD bool has_lasting_color(const Vec3f& sh0_slope, const SpacetimeShape<double>& shape) {
  using std::abs;
  using std::sqrt;
  const double in_scene = kSh0 / sqrt(covariance(shape).time);
  const double largest =
      max_of(max_of(abs(double(sh0_slope.x)), abs(double(sh0_slope.y))), abs(double(sh0_slope.z)));
  return largest * in_scene <= kStaticColorChange;
}
/// Gives row i, of this shape before, the color that it has in the middle of the scene.
GS_HD void make_color_static(const GaussiansSpan& rows, std::size_t i,
                             const SpacetimeShape<double>& shape) {
  const float phase = float(phase_at(shape, 0.5));
  rows.sh0[i] = sh0_at(rows.sh0[i], rows.sh0_slope[i], phase);
  rows.sh0_slope[i] = Vec3f(0.0f);
}

/// Clears the moments of what has another meaning in a static row.
template <class Arrays>
GS_HD void clear_for_static(const Arrays& moments, std::size_t i) {
  moments.log_scale[i] = {};
  moments.rotation[i] = {};
  moments.right_rotation[i] = {};
  moments.time_mean[i] = {};
  moments.log_time_scale[i] = {};
  if (moments.has_slope) moments.sh0_slope[i] = {};
}

/// Makes row i static if static_gaussian() is near it, and clears the moments of what has another
/// meaning then. True if it did. Rows have times.
GS_HD bool make_static(const GaussiansSpan& rows, const MomentsSpan& moments, std::size_t i,
                       double least_time_scale) {
  const Quatf l = rows.rotation[i], r = rows.right_rotation[i];
  if (is_static(rows.log_time_scale[i]) || is_degenerate(l) || is_degenerate(r)) return false;
  const SpacetimeShape<double> shape{
      Vec3d(rows.mean[i]),   Vec3d(rows.log_scale[i]), {{l.w, l.x, l.y, l.z}, {r.w, r.x, r.y, r.z}},
      rows.logit_opacity[i], rows.time_mean[i],        rows.log_time_scale[i]};
  const StaticGaussian made = static_gaussian(shape, least_time_scale);
  if (!made.is_near || (rows.has_slope && !has_lasting_color(rows.sh0_slope[i], shape)))
    return false;
  if (rows.has_slope) make_color_static(rows, i, shape);
  const Quat<double>& q = made.rotation;
  const Quatf left = static_rotation(Quatf{float(q.w), float(q.x), float(q.y), float(q.z)});
  rows.mean[i] = Vec3f(made.mean);
  rows.log_scale[i] = Vec3f(made.log_scale);
  rows.rotation[i] = left;
  rows.right_rotation[i] = mirrored(left);
  rows.logit_opacity[i] = float(made.logit_opacity);
  rows.time_mean[i] = 0.5f;
  rows.log_time_scale[i] = kStaticLogTimeScale;
  if (moments.form == MomentForm::tiny) {
    clear_for_static(moments.codes, i);
  } else {
    clear_for_static(moments.first, i);
    clear_for_static(moments.second, i);
  }
  return true;
}

/// The number of static rows, in any memory. Waits for it.
inline std::size_t static_count(const Gaussians& rows) {
  const std::vector<float> marks = rows.log_time_scale.download();
  return std::size_t(
      std::count_if(marks.begin(), marks.end(), [](float mark) { return is_static(mark); }));
}

}  // namespace gs
