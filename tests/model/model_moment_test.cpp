// SPDX-License-Identifier: Apache-2.0
// A moment of Gaussians in space and time as 3D Gaussians: the same pictures at that time, and
// through the file of the whole model.
#include "gs_model/edit/model_moment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "gs_core/error.h"
#include "gs_core/geometry/symmetric_eigen.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/rotation.h"
#include "gs_model/edit/model_transform.h"
#include "gs_model/formats/formats.h"
#include "gs_render/renderer.h"
#include "tests/support/models.h"
#include "tests/support/scenes.h"
#include "tests/support/temp_folder.h"

namespace gs {
namespace {

using testing::HasSubstr;

constexpr int kWidth = 90, kHeight = 60;

GaussianModel moving_model(const Camera& camera) {
  return {in_spacetime(random_gaussians(kTypical, 300, camera, 3), 4), kMaxShDegree, true, false};
}

std::vector<float> picture_of(const Gaussians& gaussians, const Camera& camera) {
  RenderPass pass;
  make_scalar_renderer()->forward(gaussians.span(), camera, {}, pass);
  return pass.image.download();
}

/// The share of numbers that differ by more than rounding: a fragment at 1/255 may come or go.
double share_that_differs(const std::vector<float>& a, const std::vector<float>& b) {
  std::size_t differ = 0;
  for (std::size_t i = 0; i < a.size(); ++i) differ += std::abs(a[i] - b[i]) > 1e-3f;
  return double(differ) / double(a.size());
}

TEST(SymmetricEigen, GivesTheAxesOfACovarianceBack) {
  Draws draws(5);
  for (int i = 0; i < 200; ++i) {
    const Quatf q = draws.quaternion();
    const Mat3<double> R = rotation_matrix(Quat<double>{q.w, q.x, q.y, q.z});
    const Vec3d variance{draws.log_uniform(1e-6f, 1), draws.log_uniform(1e-6f, 1), 0.5};
    const Sym3<double> S = covariance(R, variance);
    const SymmetricEigen eigen = symmetric_eigen(S);
    const Sym3<double> again = covariance(eigen.R, eigen.value);
    for (const auto& [a, b] : {std::pair{S.xx, again.xx},
                               {S.xy, again.xy},
                               {S.xz, again.xz},
                               {S.yy, again.yy},
                               {S.yz, again.yz},
                               {S.zz, again.zz}})
      EXPECT_NEAR(a, b, 1e-14);
    const Vec3d third = eigen.R.row2;  // a rotation, and no reflection
    EXPECT_NEAR(inner(cross(eigen.R.row0, eigen.R.row1), third), 1, 1e-12);
  }
}

TEST(Moment, LooksLikeTheModelAtItsTime) {
  Camera camera = random_camera(kWidth, kHeight, 2);
  const GaussianModel model = moving_model(camera);
  std::vector<float> before;
  for (const float time : {0.3f, 0.5f, 0.9f}) {
    camera.time = time;
    const std::vector<float> picture = picture_of(model.gaussians, camera);
    const GaussianModel moment = moment_of(model, double(time));
    EXPECT_FALSE(moment.gaussians.has_time);
    EXPECT_GT(moment.gaussians.count(), 20u);
    EXPECT_LE(moment.gaussians.count(), model.gaussians.count());
    EXPECT_LT(share_that_differs(picture_of(moment.gaussians, camera), picture), 2e-3);
    if (!before.empty()) {
      EXPECT_GT(share_that_differs(before, picture), 0.1);
    }
    before = picture;
  }
}

TEST(Moment, OfAModelWithoutTimeIsTheModel) {
  const Camera camera = random_camera(kWidth, kHeight, 2);
  const GaussianModel still{random_gaussians(kTypical, 50, camera, 3), kMaxShDegree, true, false};
  EXPECT_TRUE(same_bits(moment_of(still, 0.5).gaussians, still.gaussians));
}

TEST(MovingModel, ComesBackFromItsPly) {
  const TempFolder temp;
  const GaussianModel model = moving_model(random_camera(kWidth, kHeight, 2));
  const auto file = temp.path() / "a.ply", again = temp.path() / "b.ply";
  write_model(file, model);
  const GaussianModel read = read_model(file);
  ASSERT_TRUE(read.gaussians.has_time);
  EXPECT_TRUE(same_bits(read.gaussians.mean, model.gaussians.mean));
  EXPECT_TRUE(same_bits(read.gaussians.time_mean, model.gaussians.time_mean));
  EXPECT_TRUE(same_bits(read.gaussians.log_time_scale, model.gaussians.log_time_scale));
  write_model(again, read);  // quaternions were normalized when they were first written
  EXPECT_TRUE(same_bits(read_model(again).gaussians, read.gaussians));
}

TEST(MovingModel, IsRefusedByFormatsWithoutTime) {
  const TempFolder temp;
  const GaussianModel model = moving_model(random_camera(kWidth, kHeight, 2));
  for (const ModelFormat& format : model_formats()) {
    if (format.gaussians != Holds::still) continue;
    const auto file = temp.path() / ("a" + std::string(format.ending));
    try {
      write_model(file, model);
      ADD_FAILURE() << format.name;
    } catch (const UsageError& error) {
      EXPECT_THAT(error.what(), HasSubstr("gemsplat export --time"));
    }
    EXPECT_FALSE(std::filesystem::exists(file));
  }
}

TEST(MovingModel, TurnsWithACameraThatTurns) {
  Camera camera = random_camera(kWidth, kHeight, 2);
  camera.time = 0.5f;
  GaussianModel model = moving_model(camera);
  const std::vector<float> before = picture_of(model.gaussians, camera);
  const Quatf q = Draws(9).quaternion();
  const double n = 1 / std::sqrt(double(squared_norm(q)));
  const ModelTransform transform{{0.1, 0.2, 0.3}, {n * q.w, n * q.x, n * q.y, n * q.z}};
  transform_model(model, transform);
  const Mat3<double> R = rotation_matrix(transform.turn);
  const Mat3<float>& W = camera.cam_from_world_rotation;
  Camera turned = camera;
  const auto row = [&](const Vec3f& r) { return Vec3f(multiply(R, Vec3d(r))); };
  turned.cam_from_world_rotation = {row(W.row0), row(W.row1), row(W.row2)};
  turned.cam_from_world_translation += multiply(W, Vec3f(transform.center));
  EXPECT_LT(share_that_differs(picture_of(model.gaussians, turned), before), 2e-3);
  EXPECT_THROW(transform_model(model, {{0, 0, 0}, {1, 0, 0, 0}, 2}), UsageError);
}

}  // namespace
}  // namespace gs
