// SPDX-License-Identifier: Apache-2.0
// Random numbers of a test, and the numbers that vectors and matrices are made of.
#pragma once

#include "gs_core/types.h"
#include "tests/support/test.h"

namespace gs {

/// Random numbers of a test, always the same ones.
class TestRandom {
 public:
  explicit TestRandom(std::uint64_t seed = 20240229) : engine_(seed) {}
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(engine_);
  }
  double normal() { return std::normal_distribution<double>()(engine_); }
  bool chance(double probability) { return uniform(0.0, 1.0) < probability; }
  Vec3d uniform3(double low, double high) {
    return {uniform(low, high), uniform(low, high), uniform(low, high)};
  }
  /// A random rotation, with a length between 0.1 and 3.
  Quat<double> quaternion() {
    const Quat<double> q{normal(), normal(), normal(), normal()};
    const double factor = uniform(0.1, 3.0) / std::sqrt(squared_norm(q));
    return {q.w * factor, q.x * factor, q.y * factor, q.z * factor};
  }
  Quatf float_quaternion() {
    const Quat<double> q = quaternion();
    return {float(q.w), float(q.x), float(q.y), float(q.z)};
  }

 private:
  std::mt19937_64 engine_;
};

// The scalars of one value, in the order in which Unflatten reads them.
template <class T>
std::array<T, 1> scalars_of(const T& value) {
  return {value};
}
template <class T>
std::array<T, 2> scalars_of(const Vec2<T>& v) {
  return {v.x, v.y};
}
template <class T>
std::array<T, 3> scalars_of(const Vec3<T>& v) {
  return {v.x, v.y, v.z};
}
template <class T>
std::array<T, 4> scalars_of(const Quat<T>& q) {
  return {q.w, q.x, q.y, q.z};
}
template <class T>
std::array<T, 3> scalars_of(const Sym2<T>& S) {
  return {S.xx, S.xy, S.yy};
}
template <class T>
std::array<T, 6> scalars_of(const Sym3<T>& S) {
  return {S.xx, S.xy, S.xz, S.yy, S.yz, S.zz};
}
template <class T>
std::array<T, 6> scalars_of(const Mat23<T>& M) {
  return {M.row0.x, M.row0.y, M.row0.z, M.row1.x, M.row1.y, M.row1.z};
}
template <class T>
std::array<T, 9> scalars_of(const Mat3<T>& M) {
  return {M.row0.x, M.row0.y, M.row0.z, M.row1.x, M.row1.y, M.row1.z, M.row2.x, M.row2.y, M.row2.z};
}
template <class T, std::size_t N>
std::array<T, N> scalars_of(const std::array<T, N>& values) {
  return values;
}
template <class T, std::size_t N>
std::array<T, 3 * N> scalars_of(const std::array<Vec3<T>, N>& vectors) {
  std::array<T, 3 * N> all;
  for (std::size_t i = 0; i < 3 * N; ++i) all[i] = vectors[i / 3][int(i % 3)];
  return all;
}

}  // namespace gs
