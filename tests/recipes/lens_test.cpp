// SPDX-License-Identifier: Apache-2.0
// The recipe "a lens" of docs/develop/extending.md.
#include <ceres/jet.h>
#include <gtest/gtest.h>

// [recipe]
#include "data_loaders/lenses/lens_formulas.h"

namespace gs::lens_formulas {

/// Orthographic fisheye: as far from the center as the sine of the ray's angle from the axis.
///
///   u / sqrt(1 + r^2),   r = |u|
template <class T>
Vec2<T> orthographic(const Vec2<T>& u) {
  using std::sqrt;
  return u / sqrt(T(1) + inner(u, u));
}

}  // namespace gs::lens_formulas
// [end]

namespace gs {
namespace {

TEST(RecipeLens, IsTheSineOfTheAngleAndWorksOnJets) {
  const double angle = 0.7;
  const Vec2<double> landed = lens_formulas::orthographic(Vec2<double>(std::tan(angle), 0.0));
  EXPECT_NEAR(landed.x, std::sin(angle), 1e-15);
  using Jet = ceres::Jet<double, 1>;
  const Vec2<Jet> with_slope = lens_formulas::orthographic(Vec2<Jet>(Jet(0.0, 0), Jet(0.0)));
  EXPECT_EQ(with_slope.x.v[0], 1.0);  // a pinhole near the axis
}

}  // namespace
}  // namespace gs
