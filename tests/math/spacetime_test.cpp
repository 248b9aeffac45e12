// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/spacetime/spacetime.h"

#include <gtest/gtest.h>

#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/rotation.h"
#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

template <class T>
std::array<T, 16> entries(const Mat4<T>& M) {
  std::array<T, 16> all;
  for (int i = 0; i < 16; ++i) all[std::size_t(i)] = M.row[i / 4][i % 4];
  return all;
}
template <class Array>
auto mat4_of(const Array& x, std::size_t at) {
  using T = typename Array::value_type;
  Mat4<T> M;
  for (std::size_t i = 0; i < 16; ++i) M.row[i / 4][int(i % 4)] = x[at + i];
  return M;
}
template <class Array>
auto quat_of(const Array& x, std::size_t at) {
  return Quat<typename Array::value_type>{x[at], x[at + 1], x[at + 2], x[at + 3]};
}
/// The parts of a covariance, as stored entries.
template <class Array>
auto spacetime_of(const Array& x, std::size_t at) {
  using T = typename Array::value_type;
  return SpacetimeCovariance<T>{{x[at], x[at + 1], x[at + 2], x[at + 3], x[at + 4], x[at + 5]},
                                {x[at + 6], x[at + 7], x[at + 8]},
                                x[at + 9]};
}
template <class T>
std::array<T, 10> entries(const SpacetimeCovariance<T>& S) {
  return flatten(S.space, S.mixed, S.time);
}
/// From derivatives by stored entries to the gradient matrix, and back.
SpacetimeCovariance<double> gradient_of(SpacetimeCovariance<double> by_entry) {
  by_entry.space = gradient_matrix(by_entry.space);
  by_entry.mixed *= 0.5;
  return by_entry;
}
std::array<double, 10> by_entries(SpacetimeCovariance<double> gradient) {
  gradient.space = by_stored_entry(gradient.space);
  gradient.mixed *= 2.0;
  return entries(gradient);
}

SpacetimeCovariance<double> random_covariance(TestRandom& random) {
  const QuatPair<double> q{random.quaternion(), random.quaternion()};
  const Vec3d v = random.uniform3(0.05, 2.0);
  return covariance(rotation_matrix(q), Vec4<double>(v.x, v.y, v.z, random.uniform(0.05, 2.0)));
}

TEST(SpacetimeRotation, OfATurnOfSpaceIsThatTurnAndLeavesTime) {
  TestRandom random;
  for (int i = 0; i < 100; ++i) {
    const Quat<double> q = random.quaternion();
    const Mat3<double> R = rotation_matrix(q);
    const Mat4<double> R4 = rotation_matrix(turn_of_space(q));
    const Vec3d rows[3] = {R.row0, R.row1, R.row2};
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 4; ++c) {
        const double expected = r < 3 && c < 3 ? rows[r][c] : double(r == c);
        EXPECT_NEAR(R4.row[r][c], expected, 1e-12) << r << " " << c;
      }
  }
}

TEST(SpacetimeRotation, IsARotation) {
  TestRandom random;
  for (int i = 0; i < 1000; ++i) {
    const auto R = rotation_matrix(QuatPair<double>{random.quaternion(), random.quaternion()});
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < 4; ++b) EXPECT_NEAR(inner(R.row[a], R.row[b]), a == b, 1e-14);
  }
}

// The first component of the 4-vector plays the part of the real one: a pair (q, conjugate of q)
// keeps it, and turns the other three as q turns vectors.
TEST(SpacetimeRotation, OfAQuaternionAndItsConjugateTurnsThreeDimensions) {
  TestRandom random;
  const Quat<double> q = random.quaternion();
  const auto R4 = rotation_matrix(QuatPair<double>{q, {q.w, -q.x, -q.y, -q.z}});
  const Mat3<double> R = rotation_matrix(q);
  const Vec3<double> rows[3] = {R.row0, R.row1, R.row2};
  EXPECT_NEAR(R4.row[0].x, 1, 1e-14);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) EXPECT_NEAR(R4.row[i + 1][j + 1], rows[i][j], 1e-14);
}

TEST(SpacetimeRotation, GradientMatchesJet) {
  EXPECT_LT(
      worst_gradient_error(
          [](const auto& x) {
            using T = typename std::decay_t<decltype(x)>::value_type;
            return entries(rotation_matrix(QuatPair<T>{quat_of(x, 0), quat_of(x, 4)}));
          },
          [](const auto& x, const auto& g) {
            const QuatPair<double> q{quat_of(x, 0), quat_of(x, 4)};
            const auto dL = rotation_matrix_vjp(q, mat4_of(g, 0));
            return flatten(dL.left, dL.right);
          },
          [](TestRandom& random) { return flatten(random.quaternion(), random.quaternion()); }),
      kJetTolerance);
}

TEST(SpacetimeCovariance, OfAnUnrotatedGaussianIsTheDiagonalOfItsVariances) {
  const QuatPair<double> none{{1, 0, 0, 0}, {1, 0, 0, 0}};
  EXPECT_EQ(entries(covariance(rotation_matrix(none), Vec4<double>(1, 4, 9, 16))),
            (std::array{1.0, 0.0, 0.0, 4.0, 0.0, 9.0, 0.0, 0.0, 0.0, 16.0}));
}

TEST(SpacetimeCovariance, GradientMatchesJet) {
  EXPECT_LT(worst_gradient_error(
                [](const auto& x) {
                  using T = typename std::decay_t<decltype(x)>::value_type;
                  return entries(covariance(mat4_of(x, 0), Vec4<T>(x[16], x[17], x[18], x[19])));
                },
                [](const auto& x, const auto& g) {
                  const auto dL =
                      covariance_vjp(mat4_of(x, 0), Vec4<double>(x[16], x[17], x[18], x[19]),
                                     gradient_of(spacetime_of(g, 0)));
                  std::array<double, 20> all;
                  std::copy_n(entries(dL.R).begin(), 16, all.begin());
                  for (int i = 0; i < 4; ++i) all[std::size_t(16 + i)] = dL.variance[i];
                  return all;
                },
                [](TestRandom& random) {
                  std::array<double, 20> x;
                  for (double& value : x) value = random.uniform(-1.0, 1.0);
                  for (std::size_t i = 16; i < 20; ++i) x[i] = random.uniform(0.001, 2.0);
                  return x;
                }),
            kJetTolerance);
}

// The conditional Gaussian by its definition: at fixed t the 4D density is, up to a factor, the 3D
// density of the moment.
TEST(Condition, IsTheDensityAtAMoment) {
  TestRandom random;
  for (int i = 0; i < 100; ++i) {
    const QuatPair<double> q{random.quaternion(), random.quaternion()};
    const Mat4<double> R = rotation_matrix(q);
    const Vec3d v = random.uniform3(0.05, 2.0);
    const Vec4<double> variance(v.x, v.y, v.z, random.uniform(0.05, 2.0));
    const double dt = random.uniform(-1.0, 1.0);
    const auto moment = condition(covariance(R, variance), dt);
    // p^T S^-1 p = sum over the columns of R of (column . p)^2 / variance
    const auto exponent = [&](const Vec3d& at) {
      double sum = 0;
      for (int k = 0; k < 4; ++k) {
        const double along =
            R.row[0][k] * at.x + R.row[1][k] * at.y + R.row[2][k] * at.z + R.row[3][k] * dt;
        sum += along * along / variance[k];
      }
      return -0.5 * sum;
    };
    EXPECT_NEAR(std::exp(exponent(moment.shift)), moment.marginal, 1e-12);
    const Vec3d away = random.uniform3(-0.5, 0.5);
    const Sym3<double>& C = moment.covariance;  // its inverse times `away`, by Cramer's rule
    const Vec3d r0{C.xx, C.xy, C.xz}, r1{C.xy, C.yy, C.yz}, r2{C.xz, C.yz, C.zz};
    const auto cross = [](const Vec3d& a, const Vec3d& b) {
      return Vec3d{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    };
    const Vec3d solved =
        (away.x * cross(r1, r2) + away.y * cross(r2, r0) + away.z * cross(r0, r1)) /
        inner(r0, cross(r1, r2));
    EXPECT_NEAR(exponent(moment.shift + away) - exponent(moment.shift), -0.5 * inner(away, solved),
                1e-9 * (1 + inner(away, solved)));
  }
}

TEST(Condition, OfAGaussianThatDoesNotMoveChangesItsOpacityAlone) {
  const SpacetimeCovariance<double> S{{1, 0.1, 0.2, 2, 0.3, 3}, {0, 0, 0}, 0.25};
  const auto moment = condition(S, 0.5);
  EXPECT_EQ(flatten(moment.covariance), flatten(S.space));
  EXPECT_EQ(flatten(moment.shift), (std::array{0.0, 0.0, 0.0}));
  EXPECT_NEAR(moment.marginal, std::exp(-0.5), 1e-15);  // one standard deviation
}

TEST(Condition, GradientMatchesJet) {
  EXPECT_LT(
      worst_gradient_error(
          [](const auto& x) {
            const auto moment = condition(spacetime_of(x, 0), x[10]);
            return flatten(moment.covariance, moment.shift, moment.marginal);
          },
          [](const auto& x, const auto& g) {
            const auto S = spacetime_of(x, 0);
            const Sym3<double> by_entry{g[0], g[1], g[2], g[3], g[4], g[5]};
            const Instant<double> dL_dmoment{gradient_matrix(by_entry), {g[6], g[7], g[8]}, g[9]};
            const auto dL = condition_vjp(S, x[10], condition(S, x[10]), dL_dmoment);
            return flatten(by_entries(dL.S), dL.elapsed);
          },
          [](TestRandom& random) {
            return flatten(entries(random_covariance(random)), random.uniform(-1.0, 1.0));
          }),
      kJetTolerance);
}

TEST(Velocity, GradientMatchesJet) {
  EXPECT_LT(worst_gradient_error(
                [](const auto& x) { return flatten(velocity(spacetime_of(x, 0))); },
                [](const auto& x, const auto& g) {
                  return by_entries(velocity_vjp(spacetime_of(x, 0), {g[0], g[1], g[2]}));
                },
                [](TestRandom& random) { return entries(random_covariance(random)); }),
            kJetTolerance);
}

}  // namespace
}  // namespace gs
