// SPDX-License-Identifier: Apache-2.0
// Checks hand-written gradients: the forward formula runs on ceres::Jet, which computes its exact
// derivatives, and the `_vjp` must give the same.
//
//   EXPECT_LT(worst_gradient_error(forward, vjp, draw), kJetTolerance);
//
//   draw     (TestRandom&) -> array<double, N>                          one random case
//   forward  (array<T, N>) -> array<T, M>                               any scalar T
//   vjp      (array<double, N> x, array<double, M> dL_dy) -> array<double, N>
//
// flatten() and Unflatten turn the values of a formula into such arrays and back.
#pragma once

#include <ceres/jet.h>

#include "gs_core/math/render/splat.h"
#include "tests/support/numbers.h"

namespace gs {

/// Doubles round at 1e-16, and the drawn cases cancel a few digits of that; a wrong term causes a
/// much larger error.
inline constexpr double kJetTolerance = 1e-10;
inline constexpr int kJetCases = 2000;
/// A clamp counts as tested when each of its sides was seen more often than this.
inline constexpr int kEnoughCases = 100;

template <class T, std::size_t... Sizes>
auto concatenate(const std::array<T, Sizes>&... parts) {
  std::array<T, (Sizes + ...)> all;
  auto end = all.begin();
  ((end = std::copy(parts.begin(), parts.end(), end)), ...);
  return all;
}
/// All scalars of the values, one after another.
template <class... Values>
auto flatten(const Values&... values) {
  return concatenate(scalars_of(values)...);
}

/// Reads values back from a flat array, in order.
template <class T, std::size_t N>
class Unflatten {
 public:
  explicit Unflatten(const std::array<T, N>& flat) : next_(flat.data()) {}
  T scalar() { return *next_++; }
  Vec2<T> vec2() { return {scalar(), scalar()}; }
  Vec3<T> vec3() { return {scalar(), scalar(), scalar()}; }
  Quat<T> quat() { return {scalar(), scalar(), scalar(), scalar()}; }
  Sym2<T> sym2() { return {scalar(), scalar(), scalar()}; }
  Sym3<T> sym3() { return {scalar(), scalar(), scalar(), scalar(), scalar(), scalar()}; }
  Mat23<T> mat23() { return {vec3(), vec3()}; }
  Mat3<T> mat3() { return {vec3(), vec3(), vec3()}; }
  template <std::size_t Count>
  std::array<Vec3<T>, Count> vec3s() {
    std::array<Vec3<T>, Count> all;
    for (Vec3<T>& v : all) v = vec3();
    return all;
  }

 private:
  const T* next_;
};

// Gradients of symmetric matrices hold half of the derivative by the stored off-diagonal entry
// (Sym2).
template <class T>
Sym2<T> gradient_matrix(const Sym2<T>& by_stored_entry) {
  const Sym2<T>& D = by_stored_entry;
  return {D.xx, D.xy / T(2), D.yy};
}
template <class T>
Sym3<T> gradient_matrix(const Sym3<T>& by_stored_entry) {
  const Sym3<T>& D = by_stored_entry;
  return {D.xx, D.xy / T(2), D.xz / T(2), D.yy, D.yz / T(2), D.zz};
}
template <class T>
Sym2<T> by_stored_entry(const Sym2<T>& gradient_matrix) {
  const Sym2<T>& G = gradient_matrix;
  return {G.xx, T(2) * G.xy, G.yy};
}
template <class T>
Sym3<T> by_stored_entry(const Sym3<T>& gradient_matrix) {
  const Sym3<T>& G = gradient_matrix;
  return {G.xx, T(2) * G.xy, T(2) * G.xz, G.yy, T(2) * G.yz, G.zz};
}

/// dL/d(splat), for outputs that are flatten(mean2d, conic, opacity, color).
template <std::size_t N>
BasicSplatGradient<double> splat_gradient(const std::array<double, N>& dL_doutputs) {
  Unflatten in(dL_doutputs);
  BasicSplatGradient<double> gradient;
  gradient.mean2d = in.vec2();
  gradient.conic = gradient_matrix(in.sym2());
  gradient.opacity = in.scalar();
  gradient.color = in.vec3();
  return gradient;
}

/// dL/dx by Jets, and for each component the size of its terms: sum_j |dL/dy_j dy_j/dx_i|.
template <std::size_t N>
struct JetGradient {
  std::array<double, N> value{}, scale{};
};
template <class Forward, std::size_t N, std::size_t M>
JetGradient<N> jet_gradient(const Forward& forward, const std::array<double, N>& x,
                            const std::array<double, M>& dL_dy) {
  using Jet = ceres::Jet<double, int(N)>;
  std::array<Jet, N> jets;
  for (std::size_t i = 0; i < N; ++i) jets[i] = Jet(x[i], int(i));
  const std::array<Jet, M> y = forward(jets);
  JetGradient<N> gradient;
  for (std::size_t j = 0; j < M; ++j) {
    for (std::size_t i = 0; i < N; ++i) {
      const double term = dL_dy[j] * y[j].v[int(i)];
      gradient.value[i] += term;
      gradient.scale[i] += std::abs(term);
    }
  }
  return gradient;
}

/// The worst error of a component of `actual`, relative to the terms that it sums, or, if these are
/// smaller still, to a hundredth of the largest such scale. Infinite for a NaN.
template <std::size_t N>
double gradient_error(const JetGradient<N>& expected, const std::array<double, N>& actual) {
  const double largest = *std::max_element(expected.scale.begin(), expected.scale.end());
  double worst = 0.0;
  for (std::size_t i = 0; i < N; ++i) {
    const double difference = std::abs(actual[i] - expected.value[i]);
    if (difference == 0.0) continue;
    const double error = difference / std::max(expected.scale[i], 0.01 * largest);
    worst = std::isnan(error) ? std::numeric_limits<double>::infinity() : std::max(worst, error);
  }
  return worst;
}

/// The worst gradient_error() over random cases and random output gradients.
template <class Forward, class Vjp, class Draw>
double worst_gradient_error(const Forward& forward, const Vjp& vjp, const Draw& draw,
                            int cases = kJetCases) {
  TestRandom random;
  double worst = 0.0;
  for (int i = 0; i < cases; ++i) {
    const auto x = draw(random);
    auto dL_dy = forward(x);
    for (double& g : dL_dy) g = random.uniform(-1.0, 1.0);
    worst = std::max(worst, gradient_error(jet_gradient(forward, x, dL_dy), vjp(x, dL_dy)));
  }
  return worst;
}

}  // namespace gs
