// SPDX-License-Identifier: Apache-2.0
// Stage 1: world covariance of a Gaussian from its rotation and its variances.
#pragma once

#include "gs_core/types.h"

namespace gs {

/// Sigma = R diag(v) R^T   Kerbl et al. 2023, Eq. 6
///
/// R         rotation matrix
/// variance  along the columns of R      world units^2
/// Returns the symmetric world covariance   world units^2
template <class T>
GS_HD Sym3<T> covariance(const Mat3<T>& R, const Vec3<T>& variance) {
  const Vec3<T> a = R.row0 * variance, b = R.row1 * variance, c = R.row2 * variance;
  return {inner(a, R.row0), inner(a, R.row1), inner(a, R.row2),
          inner(b, R.row1), inner(b, R.row2), inner(c, R.row2)};
}

template <class T>
struct CovarianceGradient {
  Mat3<T> R;
  Vec3<T> variance;
};
/// Gradients of covariance(R, v): dL/dR = 2 G R diag(v), dL/dv_k = R_:k^T G R_:k, with G =
/// dL/dSigma.
template <class T>
GS_HD CovarianceGradient<T> covariance_vjp(const Mat3<T>& R, const Vec3<T>& variance,
                                           const Sym3<T>& dL_dsigma) {
  const Sym3<T>& G = dL_dsigma;
  const Mat3<T> GR{R.row0 * G.xx + R.row1 * G.xy + R.row2 * G.xz,
                   R.row0 * G.xy + R.row1 * G.yy + R.row2 * G.yz,
                   R.row0 * G.xz + R.row1 * G.yz + R.row2 * G.zz};
  const Vec3<T> dL_dvariance = R.row0 * GR.row0 + R.row1 * GR.row1 + R.row2 * GR.row2;
  const Vec3<T> twice = T(2) * variance;
  return {{GR.row0 * twice, GR.row1 * twice, GR.row2 * twice}, dL_dvariance};
}

}  // namespace gs
