// SPDX-License-Identifier: Apache-2.0
// The small value types that every formula is written in: vectors (GLM), matrices by rows,
// symmetric matrices by their distinct entries, quaternions. All are templated on the scalar, so
// that the same formula runs in float on the CPU and the GPU, in double in tests, and on ceres::Jet
// as its own gradient check.
#pragma once

#define GLM_FORCE_XYZW_ONLY  // no unions in glm::vec, so that it may hold a ceres::Jet
#include <cmath>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

#ifdef __CUDACC__
#define GS_HD __host__ __device__ inline
#else
#define GS_HD inline
#endif

namespace gs {

template <class T>
using Vec2 = glm::vec<2, T, glm::defaultp>;
template <class T>
using Vec3 = glm::vec<3, T, glm::defaultp>;
template <class T>
using Vec4 = glm::vec<4, T, glm::defaultp>;
using Vec2f = Vec2<float>;
using Vec3f = Vec3<float>;
using Vec4f = Vec4<float>;
using Vec3d = Vec3<double>;

/// Rotation quaternion, any length > 0. Our own type, so that `.x` never means the real part.
template <class T>
struct Quat {
  T w, x, y, z;
};
using Quatf = Quat<float>;

/// 3x3 matrix, stored and named by rows.
template <class T>
struct Mat3 {
  Vec3<T> row0, row1, row2;
};

/// 2x3 matrix, stored and named by rows.
template <class T>
struct Mat23 {
  Vec3<T> row0, row1;
};

/// Symmetric 2x2 matrix.
///
/// A gradient held in a Sym2 or Sym3 is the matrix G with dL = sum_ij G_ij dS_ij: its off-diagonal
/// entries are half of the derivative by the stored off-diagonal entry.
template <class T>
struct Sym2 {
  T xx, xy, yy;
};

/// Symmetric 3x3 matrix; gradients as in Sym2.
template <class T>
struct Sym3 {
  T xx, xy, xz, yy, yz, zz;
};

template <class T>
GS_HD T inner(const Vec2<T>& a, const Vec2<T>& b) {
  return a.x * b.x + a.y * b.y;
}
template <class T>
GS_HD T inner(const Vec3<T>& a, const Vec3<T>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
/// At right angles to both, by the right-hand rule.
template <class T>
GS_HD Vec3<T> cross(const Vec3<T>& a, const Vec3<T>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
/// False where a component is NaN or infinite, or their sum overflows.
template <class T>
GS_HD bool is_finite(const Vec3<T>& v) {
  const T sum = v.x + v.y + v.z;
  return sum - sum == T(0);
}
template <class T>
GS_HD T squared_norm(const Quat<T>& q) {
  return q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
}

/// M v
template <class T>
GS_HD Vec3<T> multiply(const Mat3<T>& M, const Vec3<T>& v) {
  return {inner(M.row0, v), inner(M.row1, v), inner(M.row2, v)};
}
/// M^T v
template <class T>
GS_HD Vec3<T> multiply_transposed(const Mat3<T>& M, const Vec3<T>& v) {
  return M.row0 * v.x + M.row1 * v.y + M.row2 * v.z;
}
/// S v
template <class T>
GS_HD Vec3<T> multiply(const Sym3<T>& S, const Vec3<T>& v) {
  return {S.xx * v.x + S.xy * v.y + S.xz * v.z, S.xy * v.x + S.yy * v.y + S.yz * v.z,
          S.xz * v.x + S.yz * v.y + S.zz * v.z};
}

/// The smaller and the larger of two values: comparisons only, so that they work on Jets and in
/// kernels; by value, so that compilers can vectorize loops around them.
template <class T>
GS_HD T min_of(T a, T b) {
  return b < a ? b : a;
}
template <class T>
GS_HD T max_of(T a, T b) {
  return a < b ? b : a;
}
template <class T>
GS_HD T clamp_to(T value, T low, T high) {
  return min_of(max_of(value, low), high);
}

/// a * b + c, with one rounding if the target has the instruction for it. Written out wherever two
/// places must compute the very same bits (forward and backward, count and emit).
template <class T>
GS_HD T multiply_add(const T& a, const T& b, const T& c) {
  return a * b + c;
}
#if defined(__CUDA_ARCH__) || defined(__FMA__)
GS_HD float multiply_add(const float& a, const float& b, const float& c) { return fmaf(a, b, c); }
GS_HD double multiply_add(const double& a, const double& b, const double& c) {
  return fma(a, b, c);
}
#endif

/// a * b + c * d, accurate also where the two products cancel: the rounding error of c * d is
/// computed and added back (Kahan).
template <class T>
GS_HD T sum_of_products(const T& a, const T& b, const T& c, const T& d) {
  const T second = c * d;
  const T rounded_off = multiply_add(c, d, -second);
  return multiply_add(a, b, second) + rounded_off;
}

}  // namespace gs
