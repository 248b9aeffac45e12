// SPDX-License-Identifier: Apache-2.0
// Stage 1, for scenes that move: a Gaussian in space and time, and the Gaussian in space that it is
// at one moment.   Yang et al. 2024 (4DGS), Faster-GS section on 4D
//
//   two quaternions, four variances -> 4D covariance -> at time t: a 3D covariance, a shift of the
//   mean, and the factor of the opacity
#pragma once

#include <cmath>

#include "gs_core/math/constants.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/types.h"

namespace gs {

/// 4x4 matrix by rows. The first three rows and columns are space (x, y, z), the last is time.
template <class T>
struct Mat4 {
  Vec4<T> row[4];
};

template <class T>
GS_HD T inner(const Vec4<T>& a, const Vec4<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
}

/// The two quaternions of a rotation in 4D. Any lengths above 0; both are normalized.
template <class T>
struct QuatPair {
  Quat<T> left, right;
};
template <class T>
GS_HD bool is_degenerate(const QuatPair<T>& q) {
  return is_degenerate(q.left) || is_degenerate(q.right);
}

/// The matrix of p -> q p, where p is the quaternion with the components (x, y, z, t) in that order.
template <class T>
GS_HD Mat4<T> left_factor(const Quat<T>& q) {
  return {{{q.w, -q.x, -q.y, -q.z},
           {q.x, q.w, -q.z, q.y},
           {q.y, q.z, q.w, -q.x},
           {q.z, -q.y, q.x, q.w}}};
}
/// The matrix of p -> p q.
template <class T>
GS_HD Mat4<T> right_factor(const Quat<T>& q) {
  return {{{q.w, -q.x, -q.y, -q.z},
           {q.x, q.w, q.z, -q.y},
           {q.y, -q.z, q.w, q.x},
           {q.z, q.y, -q.x, q.w}}};
}

template <class T>
GS_HD Mat4<T> multiply(const Mat4<T>& A, const Mat4<T>& B) {
  Mat4<T> product;
  for (int i = 0; i < 4; ++i)
    product.row[i] = B.row[0] * A.row[i].x + B.row[1] * A.row[i].y + B.row[2] * A.row[i].z +
                     B.row[3] * A.row[i].w;
  return product;
}

template <class T>
GS_HD Quat<T> normalized(const Quat<T>& q) {
  using std::sqrt;
  const T scale = T(1) / sqrt(squared_norm(q));
  return {q.w * scale, q.x * scale, q.y * scale, q.z * scale};
}
/// dL/dq of normalized(q), with the gradient by the normalized quaternion: (g - (g.u) u) / |q|.
template <class T>
GS_HD Quat<T> normalized_vjp(const Quat<T>& q, const Quat<T>& g) {
  using std::sqrt;
  const T scale = T(1) / sqrt(squared_norm(q));
  const T radial = (g.w * q.w + g.x * q.x + g.y * q.y + g.z * q.z) * scale * scale;
  return {scale * (g.w - radial * q.w), scale * (g.x - radial * q.x), scale * (g.y - radial * q.y),
          scale * (g.z - radial * q.z)};
}

/// Rotation matrix in 4D: R = L(l / |l|) Q(r / |r|), with L = left_factor and Q = right_factor. Every
/// rotation in 4D is such a product of two isoclinic ones.
template <class T>
GS_HD Mat4<T> rotation_matrix(const QuatPair<T>& q) {
  return multiply(left_factor(normalized(q.left)), right_factor(normalized(q.right)));
}
/// dL/dl and dL/dr of rotation_matrix(q). By l the factor L is linear, with dL/dL = dR Q^T; by r the
/// factor Q is, with dL/dQ = L^T dR.
template <class T>
GS_HD QuatPair<T> rotation_matrix_vjp(const QuatPair<T>& q, const Mat4<T>& dR) {
  const Mat4<T> L = left_factor(normalized(q.left)), Q = right_factor(normalized(q.right));
  T dL[4][4], dQ[4][4];
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) {
      dL[i][j] = inner(dR.row[i], Q.row[j]);
      dQ[i][j] = L.row[0][i] * dR.row[0][j] + L.row[1][i] * dR.row[1][j] +
                 L.row[2][i] * dR.row[2][j] + L.row[3][i] * dR.row[3][j];
    }
  const Quat<T> by_left{
      dL[0][0] + dL[1][1] + dL[2][2] + dL[3][3], dL[1][0] - dL[0][1] + dL[3][2] - dL[2][3],
      dL[2][0] - dL[0][2] + dL[1][3] - dL[3][1], dL[3][0] - dL[0][3] + dL[2][1] - dL[1][2]};
  const Quat<T> by_right{
      dQ[0][0] + dQ[1][1] + dQ[2][2] + dQ[3][3], dQ[1][0] - dQ[0][1] + dQ[2][3] - dQ[3][2],
      dQ[2][0] - dQ[0][2] + dQ[3][1] - dQ[1][3], dQ[3][0] - dQ[0][3] + dQ[1][2] - dQ[2][1]};
  return {normalized_vjp(q.left, by_left), normalized_vjp(q.right, by_right)};
}

/// The pair that turns space as the quaternion q does, and leaves time alone. The fourth component of
/// p = (x, y, z, t) belongs to k. So p k = (-t, z, -y, x) is a vector (z, -y, x) of space, which q
/// turns, beside -t:  p' k = q' p k q'*  with q' = (q_w, q_z, -q_y, q_x).
template <class T>
GS_HD QuatPair<T> turn_of_space(const Quat<T>& q) {
  return {{q.w, q.z, -q.y, q.x}, {q.w, q.z, -q.y, -q.x}};
}

/// Symmetric 4x4 matrix in the parts that a moment needs. A gradient held in it is the matrix G with
/// dL = sum_ij G_ij dS_ij, as in Sym3: `mixed` holds half of the derivative by the stored entry.
template <class T>
struct SpacetimeCovariance {
  Sym3<T> space;  // world units^2
  Vec3<T> mixed;  // (S_xt, S_yt, S_zt), world units * time units
  T time;         // S_tt, time units^2
};

/// S = R diag(v) R^T, with the variances along the columns of R.
template <class T>
GS_HD SpacetimeCovariance<T> covariance(const Mat4<T>& R, const Vec4<T>& variance) {
  const Vec4<T> x = R.row[0] * variance, y = R.row[1] * variance, z = R.row[2] * variance;
  return {{inner(x, R.row[0]), inner(x, R.row[1]), inner(x, R.row[2]), inner(y, R.row[1]),
           inner(y, R.row[2]), inner(z, R.row[2])},
          {inner(x, R.row[3]), inner(y, R.row[3]), inner(z, R.row[3])},
          inner(R.row[3] * variance, R.row[3])};
}

template <class T>
struct SpacetimeCovarianceGradient {
  Mat4<T> R;
  Vec4<T> variance;
};
/// Gradients of covariance(R, v): dL/dR = 2 G R diag(v), dL/dv_k = R_:k^T G R_:k, with G = dL/dS.
template <class T>
GS_HD SpacetimeCovarianceGradient<T> covariance_vjp(const Mat4<T>& R, const Vec4<T>& variance,
                                                    const SpacetimeCovariance<T>& dL_dS) {
  const Sym3<T>& G = dL_dS.space;
  const Vec3<T>& g = dL_dS.mixed;
  const Mat4<T> GR{{R.row[0] * G.xx + R.row[1] * G.xy + R.row[2] * G.xz + R.row[3] * g.x,
                    R.row[0] * G.xy + R.row[1] * G.yy + R.row[2] * G.yz + R.row[3] * g.y,
                    R.row[0] * G.xz + R.row[1] * G.yz + R.row[2] * G.zz + R.row[3] * g.z,
                    R.row[0] * g.x + R.row[1] * g.y + R.row[2] * g.z + R.row[3] * dL_dS.time}};
  SpacetimeCovarianceGradient<T> dL;
  dL.variance = Vec4<T>(T(0));
  for (int i = 0; i < 4; ++i) {
    dL.R.row[i] = GR.row[i] * (T(2) * variance);
    dL.variance += R.row[i] * GR.row[i];
  }
  return dL;
}

/// A Gaussian of space and time at one moment.
template <class T>
struct Instant {
  Sym3<T> covariance;  // of the 3D Gaussian, world units^2
  Vec3<T> shift;       // its mean is mu + shift, world units
  T marginal;          // its opacity is o * marginal; below kMinMarginal it is not rendered
};

/// How fast the mean moves, in world units per time unit: S_xyz,t / S_tt.
template <class T>
GS_HD Vec3<T> velocity(const SpacetimeCovariance<T>& S) {
  return S.mixed / S.time;
}
/// Gradient of velocity(S), as a gradient by S; only `mixed` and `time` have one.
template <class T>
GS_HD SpacetimeCovariance<T> velocity_vjp(const SpacetimeCovariance<T>& S,
                                          const Vec3<T>& dL_dvelocity) {
  const T precision = T(1) / S.time;
  SpacetimeCovariance<T> dL{};
  dL.mixed = dL_dvelocity * (T(0.5) * precision);  // half of the derivative by the stored entry
  dL.time = -precision * precision * inner(dL_dvelocity, S.mixed);
  return dL;
}

/// The Gaussian at `elapsed` = t - mu_t after its mean in time, by conditioning the 4D one on t:
///
///   shift = s dt / S_tt,  covariance = S_xyz - s s^T / S_tt,  marginal = exp(-dt^2 / (2 S_tt)),
///   with s = S_xyz,t and dt = elapsed
template <class T>
GS_HD Instant<T> condition(const SpacetimeCovariance<T>& S, const T& elapsed) {
  using std::exp;
  const Vec3<T>& s = S.mixed;
  const Vec3<T> v = velocity(S);
  return {{S.space.xx - s.x * v.x, S.space.xy - s.x * v.y, S.space.xz - s.x * v.z,
           S.space.yy - s.y * v.y, S.space.yz - s.y * v.z, S.space.zz - s.z * v.z},
          v * elapsed,
          exp(T(-0.5) * elapsed * elapsed / S.time)};
}

template <class T>
struct ConditionGradient {
  SpacetimeCovariance<T> S;
  T elapsed;  // dL/dmu_t is its negative
};
/// Gradients of condition(S, dt). With D = dL/dcovariance, g = dL/dshift, and a = 1 / S_tt:
///
///   dS_xyz = D,  ds = -2 a D s + a dt g,
///   dS_tt = a^2 (s^T D s - dt g.s + m dL/dm dt^2 / 2),  ddt = a (g.s - m dL/dm dt)
template <class T>
GS_HD ConditionGradient<T> condition_vjp(const SpacetimeCovariance<T>& S, const T& elapsed,
                                         const Instant<T>& moment, const Instant<T>& dL_dmoment) {
  const Sym3<T>& D = dL_dmoment.covariance;
  const T a = T(1) / S.time;
  const T along = inner(dL_dmoment.shift, S.mixed);
  const Vec3<T> Ds = multiply(D, S.mixed);
  const T decay = dL_dmoment.marginal * moment.marginal;
  ConditionGradient<T> dL;
  dL.S.space = D;
  dL.S.mixed = dL_dmoment.shift * (T(0.5) * a * elapsed) - Ds * a;
  dL.S.time = a * a * (inner(S.mixed, Ds) - elapsed * along + T(0.5) * decay * elapsed * elapsed);
  dL.elapsed = a * (along - decay * elapsed);
  return dL;
}

/// Whether a Gaussian is rendered at `elapsed` after its mean in time.
template <class T>
GS_HD bool is_alive(const T& marginal) {
  return marginal >= T(kMinMarginal);
}

}  // namespace gs
