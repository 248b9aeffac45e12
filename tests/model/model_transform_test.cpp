// SPDX-License-Identifier: Apache-2.0
// Turning, moving and scaling whole models: a camera that moves along sees no change.
#include "gs_model/edit/model_transform.h"

#include <gtest/gtest.h>

#include "gs_core/math/render/rotation.h"
#include "gs_core/math/render/sh.h"
#include "gs_model/formats/coding/frame.h"
#include "tests/support/random_model.h"

namespace gs {
namespace {

constexpr double kFloat = 2e-5;  // a few roundings of numbers of some units

Vec3f unit(const Vec3f& v) { return v / std::sqrt(inner(v, v)); }

ModelTransform some_transform() { return {{1, -2, 0.5}, turn_upright({0.3, 0.9, -0.4}), 2.5}; }

Mat3<double> axes_of(const Quatf& q) { return rotation_matrix(Quat<double>{q.w, q.x, q.y, q.z}); }

TEST(ModelTransform, UprightIsMinusY) {
  for (const Vec3d& up : {Vec3d(0, 0, 3), Vec3d(1, 2, -3), Vec3d(0, 1, 0), Vec3d(0, -1, 0)}) {
    const Vec3d turned = multiply(rotation_matrix(turn_upright(up)), up);
    EXPECT_NEAR(turned.x, 0, 1e-12);
    EXPECT_NEAR(turned.y, -std::sqrt(inner(up, up)), 1e-12);
    EXPECT_NEAR(turned.z, 0, 1e-12);
  }
}

TEST(ModelTransform, ColorsTurnWithTheModelAtEveryDegree) {
  for (int degree = 0; degree <= kMaxShDegree; ++degree) {
    const GaussianModel before = random_model(4, degree);
    GaussianModel after = random_model(4, degree);
    transform_model(after, some_transform());
    const Mat3<double> R = rotation_matrix(some_transform().turn);
    for (std::size_t i = 0; i < 4; ++i) {
      const Vec3f d = unit(before.gaussians.mean[(i + 1) % 4]);
      const Vec3f turned(multiply(R, Vec3d(d)));
      const Vec3f a =
          sh_color(degree, d, before.gaussians.sh0[i], before.gaussians.sh_rest[i].coefficient);
      const Vec3f b =
          sh_color(degree, turned, after.gaussians.sh0[i], after.gaussians.sh_rest[i].coefficient);
      for (int channel = 0; channel < 3; ++channel) EXPECT_NEAR(a[channel], b[channel], kFloat);
    }
  }
}

TEST(ModelTransform, MeansScalesAndAxesGoAlong) {
  const GaussianModel before = random_model(5, 0);
  GaussianModel after = random_model(5, 0);
  const ModelTransform transform = some_transform();
  transform_model(after, transform);
  const Mat3<double> R = rotation_matrix(transform.turn);
  for (std::size_t i = 0; i < 5; ++i) {
    const Vec3d expected =
        multiply(R, Vec3d(before.gaussians.mean[i]) - transform.center) * transform.scale;
    const Vec3d axis = multiply(R, multiply(axes_of(before.gaussians.rotation[i]), Vec3d(0, 0, 1)));
    const Vec3d turned_axis = multiply(axes_of(after.gaussians.rotation[i]), Vec3d(0, 0, 1));
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(after.gaussians.mean[i][k], expected[k], kFloat);
      EXPECT_NEAR(turned_axis[k], axis[k], kFloat);
      EXPECT_NEAR(after.gaussians.log_scale[i][k], before.gaussians.log_scale[i][k] + std::log(2.5),
                  kFloat);
    }
  }
}

TEST(ModelTransform, SizesOf3dFiltersAreScaled) {
  GaussianModel model = random_model(3, 0);
  model.gaussians.has_filter = true;
  model.gaussians.resize(3);
  model.gaussians.filter_scale[1] = 0.5f;
  transform_model(model, some_transform());
  EXPECT_NEAR(model.gaussians.filter_scale[1], 1.25f, 1e-6);
}

TEST(ModelTransform, TheInverseTakesTheModelBack) {
  const GaussianModel before = random_model(5, 3);
  GaussianModel after = random_model(5, 3);
  transform_model(after, some_transform());
  transform_model(after, inverse_of(some_transform()));
  for (std::size_t i = 0; i < 5; ++i)
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(after.gaussians.mean[i][k], before.gaussians.mean[i][k], kFloat);
      EXPECT_NEAR(after.gaussians.sh_rest[i].coefficient[9][k],
                  before.gaussians.sh_rest[i].coefficient[9][k], kFloat);
    }
}

TEST(ModelTransform, MatricesSayTheSameAndInvert) {
  const Mat4d there = multiply(diagonal(kHalfTurnX), matrix_of(some_transform()));
  const Mat4d both = multiply(inverse_of(there), there);
  GaussianModel model = random_model(1, 0);
  const Vec3d before(model.gaussians.mean[0]);
  transform_model(model, some_transform());
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) EXPECT_NEAR(both.m[i][j], i == j, 1e-12);
  for (int i = 0; i < 3; ++i) {
    const double moved = there.m[i][0] * before.x + there.m[i][1] * before.y +
                         there.m[i][2] * before.z + there.m[i][3];
    EXPECT_NEAR(moved, kHalfTurnX[i] * model.gaussians.mean[0][i], kFloat);
  }
}

TEST(ModelTransform, AShiftKeepsTheWorldOffsetTrue) {
  GaussianModel model = random_model(3, 0);
  model.world_offset = {500'000, 0, 7};
  const Vec3d input = Vec3d(model.gaussians.mean[1]) + model.world_offset;
  transform_model(model, {median_mean(model), {1, 0, 0, 0}, 1});
  EXPECT_NEAR((Vec3d(model.gaussians.mean[1]) + model.world_offset).z, input.z, 1e-6);
  EXPECT_EQ(median_mean(model), Vec3d(0.0));
  transform_model(model, {{0, 0, 0}, {1, 0, 0, 0}, 3});
  EXPECT_EQ(model.world_offset, Vec3d(0.0));
}

TEST(ModelTransform, ALowerShDegreeClearsTheCoefficientsBeyondIt) {
  const GaussianModel before = random_model(2, 3);
  GaussianModel after = random_model(2, 3);
  limit_sh_degree(after, 3);
  EXPECT_EQ(after.sh_degree, 3);
  limit_sh_degree(after, 1);
  EXPECT_EQ(after.sh_degree, 1);
  for (int k = 0; k < kShRestCount; ++k)
    EXPECT_EQ(after.gaussians.sh_rest[1].coefficient[k],
              k < 3 ? before.gaussians.sh_rest[1].coefficient[k] : Vec3f(0));
}

// Half turns by changes of sign equal half turns by the general rule.
TEST(ModelTransform, SignsOfHalfTurnsAreThoseOfTheRotation) {
  for (const auto& [signs, turn] : {std::pair(kHalfTurnX, Quat<double>{0, 1, 0, 0}),
                                    std::pair(kHalfTurnZ, Quat<double>{0, 0, 0, 1})}) {
    const GaussianModel before = random_model(2, 3);
    GaussianModel after = random_model(2, 3);
    transform_model(after, {{0, 0, 0}, turn, 1});
    for (int k = 0; k < kShRestCount; ++k)
      EXPECT_NEAR(after.gaussians.sh_rest[1].coefficient[k].x,
                  sh_sign(k, signs) * before.gaussians.sh_rest[1].coefficient[k].x, 1e-6)
          << k;
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(after.gaussians.mean[1][axis], signs[axis] * before.gaussians.mean[1][axis],
                  1e-6);
  }
}

}  // namespace
}  // namespace gs
