// SPDX-License-Identifier: Apache-2.0
// Stage 8 for scenes that move: what a Gaussian in space and time adds to the loss, so that it lives
// long and moves slowly unless the photos say otherwise. Where each moment has one photo, a Gaussian
// that lives for that photo alone fits it and nothing else.
#pragma once

#include "gs_core/math/density/mcmc.h"
#include "gs_core/math/spacetime/spacetime_splat.h"

namespace gs {

template <class T>
GS_HD void add(Quat<T>& to, const Quat<T>& q) {
  to.w += q.w;
  to.x += q.x;
  to.y += q.y;
  to.z += q.z;
}

/// Whether a Gaussian lives long enough for its velocity to count: 1e-4 durations.
template <class T>
GS_HD bool has_velocity(const SpacetimeCovariance<T>& S) {
  return S.time >= T(kMinTimeVariance);
}

/// The loss that one Gaussian adds.
///
///   w_t / s_t + w_v |v|^2,   w of_each(), s_t the scale in time, v the velocity
///
/// A Gaussian without a velocity has the first part alone.
template <class T>
GS_HD T spacetime_regularizer(const SpacetimeShape<T>& shape, const Regularizers& of_each) {
  using std::exp;
  const T by_time = T(of_each.time_scale) * exp(-limited_log_time_scale(shape.log_time_scale));
  const SpacetimeCovariance<T> S = covariance(shape);
  if (!has_velocity(S)) return by_time;
  const Vec3<T> v = velocity(S);
  return by_time + T(of_each.velocity) * inner(v, v);
}
/// Adds the gradients of spacetime_regularizer() to those of the parameters. Zero by v for a
/// Gaussian without a rotation.
template <class T>
GS_HD void add_spacetime_regularizer_vjp(const SpacetimeShape<T>& shape,
                                         const Regularizers& of_each, SpacetimeShape<T>& dL) {
  using std::exp;
  const bool is_limited = lives_longest(shape.log_time_scale);
  if (!is_limited) dL.log_time_scale -= T(of_each.time_scale) * exp(-shape.log_time_scale);
  if (of_each.velocity == 0 || is_degenerate(shape.rotations)) return;
  const Mat4<T> R = rotation_matrix(shape.rotations);
  const Vec4<T> variances = variance(shape.log_scale, shape.log_time_scale);
  const SpacetimeCovariance<T> S = covariance(R, variances);
  if (!has_velocity(S)) return;
  const SpacetimeCovarianceGradient<T> by =
      covariance_vjp(R, variances, velocity_vjp(S, velocity(S) * T(2 * of_each.velocity)));
  const Vec4<T> by_log_scale = T(2) * variances * by.variance;
  const QuatPair<T> by_rotations = rotation_matrix_vjp(shape.rotations, by.R);
  dL.log_scale += Vec3<T>(by_log_scale.x, by_log_scale.y, by_log_scale.z);
  if (!is_limited) dL.log_time_scale += by_log_scale.w;
  add(dL.rotations.left, by_rotations.left);
  add(dL.rotations.right, by_rotations.right);
}

}  // namespace gs
