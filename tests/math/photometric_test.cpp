// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/loss/photometric.h"
#include "gs_core/math/loss/pull.h"

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

TEST(Gained, GradientMatchesJet) {
  const auto forward = [](const auto& x) {
    using T = std::decay_t<decltype(x[0])>;
    return std::array<T, 1>{gained(x[0], x[1])};
  };
  const auto vjp = [](const std::array<double, 2>& x, const std::array<double, 1>& G) {
    const auto gradient = gained_vjp(gained(x[0], x[1]), std::exp(x[1]), G[0]);
    return std::array<double, 2>{gradient.x, gradient.a};
  };
  const auto draw = [](TestRandom& random) {
    return std::array<double, 2>{random.uniform(-0.2, 1.5), random.uniform(-1, 1)};
  };
  EXPECT_LT(worst_gradient_error(forward, vjp, draw), kJetTolerance);
}

TEST(PhotoPull, GradientMatchesJet) {
  const auto forward = [](const auto& x) {
    using T = std::decay_t<decltype(x[0])>;
    const T off = (x[0] - T(0.3)) / T(0.5);
    return std::array<T, 1>{T(0.5) * T(0.01) * off * off};
  };
  const auto vjp = [](const std::array<double, 1>& x, const std::array<double, 1>& G) {
    return std::array<double, 1>{G[0] * pull_vjp(x[0], 0.3, 0.01, 0.5)};
  };
  const auto draw = [](TestRandom& random) { return std::array<double, 1>{random.uniform(-1, 1)}; };
  EXPECT_LT(worst_gradient_error(forward, vjp, draw), kJetTolerance);
}

}  // namespace
}  // namespace gs
