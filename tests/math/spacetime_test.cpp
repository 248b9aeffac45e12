// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/spacetime/spacetime.h"

#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/rotation.h"
#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

template <class T>
std::array<T, 10> entries(const SpacetimeCovariance<T>& S) {
  return flatten(S.space, S.mixed, S.time);
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

TEST(SpacetimeCovariance, OfAnUnrotatedGaussianIsTheDiagonalOfItsVariances) {
  const QuatPair<double> none{{1, 0, 0, 0}, {1, 0, 0, 0}};
  EXPECT_EQ(entries(covariance(rotation_matrix(none), Vec4<double>(1, 4, 9, 16))),
            (std::array{1.0, 0.0, 0.0, 4.0, 0.0, 9.0, 0.0, 0.0, 0.0, 16.0}));
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

}  // namespace
}  // namespace gs
