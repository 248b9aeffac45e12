// SPDX-License-Identifier: Apache-2.0
// Stages 1 and 7 of cameras that move while their rows are exposed: against cameras that stand still
// at the time of a row, and against Jets.
#include "gs_core/math/render/rolling_shutter.h"

#include "data_loaders/lenses/lens_range.h"
#include "gs_core/math/render/rotation.h"
#include "tests/data_loaders/photos/lens_cases.h"
#include "tests/support/flat_gaussian.h"

namespace gs {
namespace {

struct MovingCase {
  std::string label;
  PinholeCamera<double> camera;
};

/// A pinhole, a strong lens and a fisheye that sees beside the camera.
const std::vector<MovingCase>& moving_cases() {
  using enum CameraModel;
  static const std::vector<MovingCase> all = [] {
    const LensCase lenses[] = {
        {"pinhole", {1, pinhole, 320, 240, {150, 160, 158, 122}}},
        {"strong", {1, opencv, 320, 240, {200, 210, 158, 122, -0.2, 0.03, 2e-3, -1e-3}}},
        {"110 degrees",
         {1, opencv_fisheye, 320, 240, {105, 104, 158, 122, 0.02, -0.01, 0.003, -4e-4}}}};
    std::vector<MovingCase> cases;
    for (const LensCase& lens : lenses)
      cases.push_back({lens.label, row_by_row_camera(lens_camera(lens.camera, "a.jpg"),
                                                     LensUse::native, "a.jpg")});
    return cases;
  }();
  return all;
}

/// A camera anywhere, whose points move by up to a third of the picture while it is exposed.
PinholeCamera<double> draw_moving(TestRandom& random, const MovingCase& lens) {
  PinholeCamera<double> camera = lens.camera;
  camera.cam_from_world_rotation = rotation_matrix(random.quaternion());
  camera.cam_from_world_translation = random.uniform3(-2, 2);
  return with_motion(camera, {random.uniform3(-0.15, 0.15), random.uniform3(-0.2, 0.2)});
}

/// A point before the camera at mid time, most of them inside the picture and its lens.
Vec3d draw_point(TestRandom& random, const PinholeCamera<double>& camera) {
  const double reach = std::min(0.7, 0.7 * camera.lens.radius);
  return random.uniform(0.8, 6) *
         Vec3d(random.uniform(-reach, reach), 2.5 * random.uniform(-reach, reach), 1);
}

/// The place in the world of a point in the axes of a camera.
Vec3d in_world(const PinholeCamera<double>& camera, const Vec3d& p) {
  return multiply_transposed(camera.cam_from_world_rotation, p - camera.cam_from_world_translation);
}

/// The camera that stands still where the moving one is at a time of 0 (first row) to 1.
PinholeCamera<double> at_time(PinholeCamera<double> camera, double time) {
  const auto [turn, shift] = camera.lens.motion;
  const double angle = std::sqrt(inner(turn, turn)), half = (time - 0.5) * angle / 2;
  const Vec3d axis = std::sin(half) / angle * turn;
  const Mat3<double> R = rotation_matrix(Quat<double>{std::cos(half), axis.x, axis.y, axis.z});
  const Mat3<double> W = camera.cam_from_world_rotation;
  const Vec3d center = camera.position() + (time - 0.5) * multiply_transposed(W, shift);
  const auto row = [&](const Vec3d& of) { return multiply_transposed(W, of); };
  camera.cam_from_world_rotation = {row(R.row0), row(R.row1), row(R.row2)};
  camera.cam_from_world_translation = -multiply(camera.cam_from_world_rotation, center);
  camera.lens.motion = {};
  return camera;
}

Vec2d seen_by(const PinholeCamera<double>& still, const Vec3d& mean) {
  return project_through_lens(still, to_camera(still, mean)).mean2d;
}

TEST(RollingShutter, PointsAreSeenFromThePoseOfTheirOwnRow) {
  for (const MovingCase& lens : moving_cases()) {
    TestRandom random;
    int compared = 0;
    for (int i = 0; i < 300; ++i) {
      const PinholeCamera<double> camera = draw_moving(random, lens);
      const Vec3d p = draw_point(random, camera);
      const Vec3d mean = in_world(camera, p);
      // How far the row of a time is above the point at that time.
      const auto above = [&](double time) {
        return seen_by(at_time(camera, time), mean).y - time * camera.height;
      };
      if (!(above(0) > 0 && above(1) < 0)) continue;  // it leaves the picture
      double low = 0, high = 1;
      for (int halving = 0; halving < 60; ++halving)
        (above((low + high) / 2) > 0 ? low : high) = (low + high) / 2;
      const Vec2d expected = seen_by(at_time(camera, low), mean);
      const ProjectedPoint<double> point = project_point(camera, p);
      EXPECT_NEAR(point.mean2d.x, expected.x, 1e-8) << lens.label;
      EXPECT_NEAR(point.mean2d.y, expected.y, 1e-8) << lens.label;
      ++compared;
    }
    EXPECT_GT(compared, kEnoughCases) << lens.label;
  }
}

TEST(RollingShutter, AIsTheDerivativeOfTheMean) {
  for (const MovingCase& lens : moving_cases()) {
    TestRandom random;
    int compared = 0;
    for (int i = 0; i < 300; ++i) {
      const PinholeCamera<double> camera = draw_moving(random, lens);
      const Vec3d p = draw_point(random, camera);
      if (!exposed_point(camera, p).moves || !std::isfinite(exposed_point(camera, p).lag)) continue;
      const auto by_jet = [&](double gx, double gy) {
        const auto project = [&](const auto& x) {
          using T = std::decay_t<decltype(x[0])>;
          const auto seen = camera_as<T>(camera);
          return flatten(project_point(seen, to_camera(seen, Unflatten(x).vec3())).mean2d);
        };
        const Vec3d mean = in_world(camera, p);
        return jet_gradient(project, flatten(mean), std::array{gx, gy});
      };
      const Mat23<double> A = project_point(camera, p).A;
      EXPECT_LT(gradient_error(by_jet(1, 0), flatten(A.row0)), 1e-8) << lens.label;
      EXPECT_LT(gradient_error(by_jet(0, 1), flatten(A.row1)), 1e-8) << lens.label;
      ++compared;
    }
    EXPECT_GT(compared, kEnoughCases) << lens.label;
  }
}

constexpr SplatSettings kMovingSettings{};

// No term is left out: also those by which the time and the speed follow the mean.
TEST(RollingShutter, GradientMatchesJet) {
  for (const MovingCase& lens : moving_cases()) {
    PinholeCamera<double> camera;
    int moving = 0, still = 0;
    const double worst = worst_flat_gradient_error(
        camera, kMovingSettings,
        [&](TestRandom& random) {
          for (;;) {
            camera = draw_moving(random, lens);
            const Vec3d p = draw_point(random, camera);
            const Vec3d mean = in_world(camera, p);
            const auto x = flatten(mean, random.uniform3(-4.5, -2.5), random.quaternion(),
                                   random.uniform(-3.0, 5.0));
            const ExposedPoint<double> point = exposed_point(camera, p);
            const bool is_above_or_below =
                std::abs(point.seen.mean2d.y / camera.height - 0.5) > 0.5 + kFrustumMargin;
            if (!project_flat(camera, kMovingSettings, x).is_visible ||
                (!point.moves && !is_above_or_below))
              continue;
            ++(point.moves ? moving : still);
            return x;
          }
        },
        1000);
    EXPECT_LT(worst, 1e-7) << lens.label;
    EXPECT_GT(moving, kEnoughCases) << lens.label;
    if (has_perspective_chart(camera.lens.lens)) {
      EXPECT_GT(still, 5) << lens.label;
    }
  }
}

// The rows keep their times, and so the pixels what they show.
TEST(RollingShutter, IsTheSameWhereThePictureIsCutOrScaled) {
  for (const MovingCase& lens : moving_cases()) {
    TestRandom random;
    for (int i = 0; i < 100; ++i) {
      const PinholeCamera<double> camera = draw_moving(random, lens);
      const Vec3d p = draw_point(random, camera);
      PinholeCamera<double> other = resized(camera, camera.width / 2, camera.height / 4);
      other.height -= 10, other.cy -= 5;
      const Vec2d whole = project_point(camera, p).mean2d, cut = project_point(other, p).mean2d;
      EXPECT_NEAR(cut.x, whole.x / 2, 1e-8) << lens.label;
      EXPECT_NEAR(cut.y, whole.y / 4 - 5, 1e-8) << lens.label;
    }
  }
}

// A point that runs down the picture nearly as fast as the rows would fill it.
TEST(RollingShutter, DoesNotDrawWhatTheRowsNeverPass) {
  const PinholeCamera<double> still =
      row_by_row_camera(lens_camera({1, CameraModel::pinhole, 100, 100, {100, 100, 50, 50}}, ""),
                        LensUse::native, "");
  const auto is_drawn = [&](double heights) {
    // What lies at z = 1 moves down by so many.
    const auto camera = with_motion<double>(still, {Vec3d(0.0), {0, -heights, 0}});
    const std::array<double, 11> x{0, 0, 1, -3, -3, -3, 1, 0, 0, 0, 2};
    return project_flat(camera, kMovingSettings, x).is_visible;
  };
  EXPECT_TRUE(is_drawn(0.8));
  EXPECT_FALSE(is_drawn(0.95));
  EXPECT_FALSE(is_drawn(1.5));
  EXPECT_TRUE(is_drawn(-3));
}

}  // namespace
}  // namespace gs
