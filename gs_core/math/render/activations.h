// SPDX-License-Identifier: Apache-2.0
// Stage 1: from stored parameters to the quantities of the method: opacity and variance.
#pragma once

#include "gs_core/types.h"

namespace gs {

/// Opacity of a stored logit, o = 1 / (1 + exp(-x)).   Kerbl et al. 2023, Sec. 5.1
template <class T>
GS_HD T sigmoid(const T& x) {
  using std::exp;
  return T(1) / (T(1) + exp(-x));
}
/// dL/dx of o = sigmoid(x), given o.
template <class T>
GS_HD T sigmoid_vjp(const T& opacity, const T& dL_dopacity) {
  return dL_dopacity * opacity * (T(1) - opacity);
}

/// The inverse of sigmoid, for 0 < o < 1.
template <class T>
GS_HD T logit(const T& opacity) {
  using std::log;
  return log(opacity / (T(1) - opacity));
}

/// Variances along the Gaussian's axes, exp(2 s), from log standard deviations s.   world units^2
template <class T>
GS_HD Vec3<T> variance(const Vec3<T>& log_scale) {
  using std::exp;
  return {exp(T(2) * log_scale.x), exp(T(2) * log_scale.y), exp(T(2) * log_scale.z)};
}
/// dL/ds of variance(s), given the variance.
template <class T>
GS_HD Vec3<T> variance_vjp(const Vec3<T>& variance, const Vec3<T>& dL_dvariance) {
  return T(2) * variance * dL_dvariance;
}

}  // namespace gs
