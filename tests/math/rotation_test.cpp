// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/render/rotation.h"

#include "gs_core/math/render/quaternion.h"
#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

void expect_near(const Mat3<double>& actual, const Mat3<double>& expected, double tolerance) {
  const auto a = flatten(actual), e = flatten(expected);
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], e[i], tolerance) << "entry " << i;
}

TEST(Rotation, QuarterTurnAboutZTakesXToY) {
  const double h = std::sqrt(0.5);
  const Vec3d y = multiply(rotation_matrix(Quat<double>{h, 0.0, 0.0, h}), Vec3d{1.0, 0.0, 0.0});
  EXPECT_NEAR(y.x, 0.0, 1e-15);
  EXPECT_NEAR(y.y, 1.0, 1e-15);
  EXPECT_NEAR(y.z, 0.0, 1e-15);
}

// Rodrigues' formula R = cos I + sin [u]x + (1 - cos) u u^T with u = (2, -1, 2) / 3 and angle 0.7,
// worked out in Python's decimal; the quaternion is (cos 0.35, sin 0.35 u).
TEST(Rotation, AgreesWithRodriguesFormula) {
  const double s = std::sin(0.35) / 3.0;
  expect_near(rotation_matrix(Quat<double>{std::cos(0.35), 2.0 * s, -s, 2.0 * s}),
              {{0.86935677071360473, -0.48173574987301881, -0.11022464565011410},
               {0.37722116644390258, 0.79097083314176753, -0.48173574987301881},
               {0.31925381250834661, 0.37722116644390258, 0.86935677071360473}},
              1e-15);
}

TEST(Rotation, DoesNotDependOnTheLengthOfTheQuaternion) {
  const Mat3<double> R = rotation_matrix(Quat<double>{0.3, -0.2, 0.5, 0.1});
  expect_near(rotation_matrix(Quat<double>{30.0, -20.0, 50.0, 10.0}), R, 1e-15);
}

TEST(QuaternionOf, IsTheWayBackFromEveryRotation) {
  TestRandom random;
  for (int i = 0; i < 1000; ++i) {  // each component is the largest one in some
    const Mat3<double> R = rotation_matrix(random.quaternion());
    const Quat<double> q = quaternion_of(R);
    EXPECT_NEAR(squared_norm(q), 1, 1e-14);
    expect_near(rotation_matrix(q), R, 1e-14);
  }
  for (const Quat<double>& half_turn : {Quat<double>{0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}})
    expect_near(rotation_matrix(quaternion_of(rotation_matrix(half_turn))),
                rotation_matrix(half_turn), 1e-15);
}

TEST(Rotation, IsOrthogonalInFloatForEveryLength) {
  TestRandom random;
  for (int i = 0; i < 1000; ++i) {
    const Quat<double> q = random.quaternion();
    const float f = float(std::pow(10.0, random.uniform(-2.0, 5.0)));
    const Mat3<float> R =
        rotation_matrix(Quatf{float(q.w) * f, float(q.x) * f, float(q.y) * f, float(q.z) * f});
    // Entries are sums of three products in float: a few times 1.2e-7.
    EXPECT_NEAR(inner(R.row0, R.row0), 1.0f, 2e-6f);
    EXPECT_NEAR(inner(R.row1, R.row1), 1.0f, 2e-6f);
    EXPECT_NEAR(inner(R.row0, R.row1), 0.0f, 2e-6f);
    EXPECT_NEAR(inner(R.row1, R.row2), 0.0f, 2e-6f);
  }
}

TEST(Rotation, ShortQuaternionIsDegenerate) {
  EXPECT_TRUE(is_degenerate(Quatf{0.99e-4f, 0.0f, 0.0f, 0.0f}));  // |q|^2 just below 1e-8
  EXPECT_FALSE(is_degenerate(Quatf{0.0f, 0.0f, 1.01e-4f, 0.0f}));
}

TEST(Rotation, NanQuaternionIsDegenerate) {
  EXPECT_TRUE(is_degenerate(Quatf{1.0f, std::numeric_limits<float>::quiet_NaN(), 0.0f, 0.0f}));
}

}  // namespace
}  // namespace gs
