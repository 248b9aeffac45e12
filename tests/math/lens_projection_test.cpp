// SPDX-License-Identifier: Apache-2.0
// Stages 1 and 7 through lenses: the maps with their derivatives, the angle chart, and the chain of
// both, against Jets and against the formulas that undistort photos.
#include "gs_core/math/lens/lens_projection.h"

#include <numbers>

#include "data_loaders/lenses/lens_range.h"
#include "gs_core/math/render/rotation.h"
#include "tests/data_loaders/photos/lens_cases.h"
#include "tests/support/flat_gaussian.h"

namespace gs {
namespace {

using std::numbers::pi;

/// Lenses that reach beside and behind the camera, and one that folds inside its picture.
std::vector<LensCase> wide_cases() {
  using enum CameraModel;
  return {{"equidistant, 95 degrees", {1, simple_fisheye, 320, 320, {96.5, 160, 160}}},
          {"equidistant, 150 degrees", {1, fisheye, 320, 240, {70, 71, 158, 122}}},
          {"polynomial, 110 degrees",
           {1, opencv_fisheye, 320, 240, {105, 104, 158, 122, 0.02, -0.01, 0.003, -4e-4}}},
          {"folds", {1, opencv, 320, 240, {150, 150, 160, 120, -0.35, 0.02, 1e-3, -1e-3}}}};
}

std::vector<LensCase> all_cases() {
  std::vector<LensCase> cases = lens_cases();
  for (const LensCase& lens : wide_cases()) cases.push_back(lens);
  return cases;
}

PinholeCamera<double> seeing(const LensCase& lens) {
  return camera_with_lens(lens_camera(lens.camera, "a.jpg"), "a.jpg");
}

/// A point of the chart inside the lens or on its axis.
Vec2d draw_inside(TestRandom& random, const CameraLens<double>& lens) {
  const double turn = random.uniform(0, 2 * pi);
  const double r = random.chance(0.05) ? 0 : std::min(lens.radius, 2.0) * random.uniform(0, 1);
  return {r * std::cos(turn), r * std::sin(turn)};
}

template <class T>
CameraLens<T> lens_of(const PinholeCamera<double>& camera) {
  return lens_as<T>(camera.lens);
}

TEST(LensMap, FirstAndSecondDerivativesMatchJetForEveryModel) {
  for (const LensCase& lens : all_cases()) {
    const PinholeCamera<double> camera = seeing(lens);
    TestRandom random;
    for (int i = 0; i < 300; ++i) {
      const Vec2d u = draw_inside(random, camera.lens);
      using Jet = ceres::Jet<double, 2>;
      const MapAt<Jet> jet = map_at(lens_of<Jet>(camera), Vec2<Jet>(Jet(u.x, 0), Jet(u.y, 1)));
      const MapAt<double> map = map_at(camera.lens, u);
      const double scale = 1 + std::abs(map.row_x.x) + std::abs(map.curve_x.xx) +
                           std::abs(map.curve_y.yy) + std::abs(map.curve_x.xy);
      const auto expect = [&](const Jet& by_jet, double by_x, double by_y) {
        EXPECT_NEAR(by_jet.v[0], by_x, 1e-10 * scale) << lens.label << " at " << u.x << ' ' << u.y;
        EXPECT_NEAR(by_jet.v[1], by_y, 1e-10 * scale) << lens.label << " at " << u.x << ' ' << u.y;
      };
      expect(jet.value.x, map.row_x.x, map.row_x.y);
      expect(jet.value.y, map.row_y.x, map.row_y.y);
      expect(jet.row_x.x, map.curve_x.xx, map.curve_x.xy);
      expect(jet.row_x.y, map.curve_x.xy, map.curve_x.yy);
      expect(jet.row_y.x, map.curve_y.xx, map.curve_y.xy);
      expect(jet.row_y.y, map.curve_y.xy, map.curve_y.yy);
    }
  }
}

// projected() of lens_cases.h shares no code with the lenses.
TEST(ProjectThroughLens, LandsWhereColmapsModelsDo) {
  for (const LensCase& lens : lens_cases()) {
    const PinholeCamera<double> camera = seeing(lens);
    TestRandom random;
    for (int i = 0; i < 100; ++i) {
      const Vec2d u = draw_inside(random, camera.lens);
      const double theta = std::sqrt(inner(u, u));
      const bool has_angles = has_angle_chart(camera.lens.lens);
      if (has_angles && theta > 1.5) continue;  // COLMAP's end at 90 degrees
      const double ratio = has_angles && theta > 0 ? std::tan(theta) / theta : 1;
      const Vec2d ray = ratio * u;
      if (ray.x < camera.lens.low.x || ray.x > camera.lens.high.x || ray.y < camera.lens.low.y ||
          ray.y > camera.lens.high.y)
        continue;
      const double z = random.uniform(0.5, 4);
      const Vec2d at = project_through_lens(camera, Vec3d(ray.x * z, ray.y * z, z)).mean2d;
      const Vec2d expected = projected(lens.camera, ray.x * z, ray.y * z, z);
      EXPECT_NEAR(at.x, expected.x, 1e-8) << lens.label << " at " << u.x << ' ' << u.y;
      EXPECT_NEAR(at.y, expected.y, 1e-8) << lens.label << " at " << u.x << ' ' << u.y;
    }
  }
}

/// A direction at an angle from the axis, at a distance of 0.5 to 4.
Vec3d draw_at(TestRandom& random, double theta) {
  const double turn = random.uniform(0, 2 * pi), d = random.uniform(0.5, 4);
  return {d * std::sin(theta) * std::cos(turn), d * std::sin(theta) * std::sin(turn),
          d * std::cos(theta)};
}

// Angles on both sides of where the series ends, of 90 degrees, and near both ends of the axis.
TEST(AngleChart, JacobianAndItsGradientMatchJetAtEveryAngle) {
  for (const double theta : {0.0, 1e-6, 0.01, 0.28, 0.2914, 0.2915, 0.31, 1.0, pi / 2 - 1e-6,
                             pi / 2 + 1e-6, 1.9, 2.6, 3.04}) {
    const auto draw = [&](TestRandom& random) { return flatten(draw_at(random, theta)); };
    const double of_chart = worst_gradient_error(
        [&](const auto& x) { return flatten(angle_chart(Unflatten(x).vec3()).u); },
        [&](const auto& x, const auto& g) {
          const Vec3d p = Unflatten(x).vec3();
          const Mat23<double> J = jacobian(angle_chart(p), p);
          return flatten(g[0] * J.row0 + g[1] * J.row1);
        },
        draw, 200);
    const double of_jacobian = worst_gradient_error(
        [&](const auto& x) {
          const auto p = Unflatten(x).vec3();
          return flatten(jacobian(angle_chart(p), p));
        },
        [&](const auto& x, const auto& g) {
          const Vec3d p = Unflatten(x).vec3();
          return flatten(jacobian_vjp(angle_chart(p), p, Unflatten(g).mat23()));
        },
        draw, 200);
    EXPECT_LT(of_chart, 1e-9) << theta;
    EXPECT_LT(of_jacobian, 1e-9) << theta;
  }
}

TEST(AngleChart, IsAccurateInSinglePrecision) {
  TestRandom random;
  for (int i = 0; i < 2000; ++i) {
    const Vec3d p = draw_at(random, random.uniform(0, 3.0));
    const Vec3f q(p);
    const Mat23<double> J = jacobian(angle_chart(Vec3d(q)), Vec3d(q));
    const Mat23<float> K = jacobian(angle_chart(q), q);
    const auto expected = flatten(J);
    const auto actual = flatten(K);
    const double size = std::sqrt(inner(J.row0, J.row0) + inner(J.row1, J.row1));
    for (std::size_t k = 0; k < 6; ++k) EXPECT_NEAR(actual[k], expected[k], 1e-5 * size);
  }
}

/// Inside the lens, beyond its range, and beyond its radius.
struct LensVisits {
  int inside = 0, outside = 0;
};

/// A point in camera space, inside the lens or beyond it.
Vec3d draw_before(TestRandom& random, const PinholeCamera<double>& camera, LensVisits& visits) {
  const CameraLens<double>& lens = camera.lens;
  Vec3d p;
  if (has_angle_chart(lens.lens)) {
    p = draw_at(random, std::min(1.15 * lens.radius, 3.0) * random.uniform(0, 1));
    const auto u = angle_chart(p).u;
    (inner(u, u) < lens.radius * lens.radius ? visits.inside : visits.outside) += 1;
  } else {
    const double z = random.uniform(0.3, 8.0);
    const auto drawn = [&](double low, double high) {
      return z * 1.4 * random.uniform(std::max(low, -lens.radius), std::min(high, lens.radius));
    };
    p.x = drawn(lens.low.x, lens.high.x);
    p.y = drawn(lens.low.y, lens.high.y);
    p.z = z;
    const PointInLens<double> at = point_in_lens(lens, Vec2d(p.x / z, p.y / z));
    (at.inside == at.u ? visits.inside : visits.outside) += 1;
  }
  return p;
}

TEST(ProjectThroughLens, GradientMatchesJetInsideAndBeyondEveryLens) {
  for (const LensCase& lens : all_cases()) {
    PinholeCamera<double> camera = seeing(lens);
    LensVisits visits;
    const double worst = worst_gradient_error(
        [&](const auto& x) {
          using T = std::decay_t<decltype(x[0])>;
          const auto point = project_through_lens(camera_as<T>(camera), Unflatten(x).vec3());
          return flatten(point.mean2d, point.A);
        },
        [&](const auto& x, const auto& g) {
          Unflatten in(g);
          const Vec2d dL_dmean2d = in.vec2();
          return flatten(
              project_through_lens_vjp(camera, Unflatten(x).vec3(), dL_dmean2d, in.mat23()));
        },
        [&](TestRandom& random) {
          camera.cam_from_world_rotation = rotation_matrix(random.quaternion());
          return flatten(draw_before(random, camera, visits));
        },
        500);
    EXPECT_LT(worst, 1e-8) << lens.label;
    EXPECT_GT(visits.inside, kEnoughCases) << lens.label;
  }
}

TEST(ProjectThroughLens, AIsTheDerivativeOfTheMeanInsideTheLens) {
  for (const LensCase& lens : all_cases()) {
    const PinholeCamera<double> camera = seeing(lens);
    TestRandom random;
    for (int i = 0; i < 200; ++i) {
      LensVisits visits;
      const Vec3d p = draw_before(random, camera, visits);
      if (visits.outside) continue;
      const auto by_jet = [&](double gx, double gy) {
        const auto project = [&](const auto& x) {
          using T = std::decay_t<decltype(x[0])>;
          return flatten(project_through_lens(camera_as<T>(camera), Unflatten(x).vec3()).mean2d);
        };
        return jet_gradient(project, flatten(p), std::array{gx, gy});
      };
      const Mat23<double> A = project_through_lens(camera, p).A;
      EXPECT_LT(gradient_error(by_jet(1, 0), flatten(A.row0)), 1e-9) << lens.label;
      EXPECT_LT(gradient_error(by_jet(0, 1), flatten(A.row1)), 1e-9) << lens.label;
    }
  }
}

// With coefficients of 0 the lens is a pinhole, also beyond the frustum's limits.
TEST(ProjectThroughLens, IsThePinholeWithoutDistortion) {
  LensCamera ideal;
  ideal.pinhole = {640, 420, 500, 480, 310, 190};
  ideal.lens = Lens::radial_tangential;
  PinholeCamera<double> camera = camera_with_lens(ideal, "a.jpg");
  camera.lens.radius = 10;  // not that of the picture's corners
  TestRandom random;
  for (int i = 0; i < 2000; ++i) {
    const double z = random.uniform(0.3, 8.0);
    const Vec3d p{z * random.uniform(-1.8, 1.8), z * random.uniform(-1.8, 1.8), z};
    const auto through = project_through_lens(camera, p);
    const Vec2d mean = project_mean(ideal.pinhole, p);
    const Mat23<double> A = projection_jacobian(ideal.pinhole, p);
    EXPECT_NEAR(through.mean2d.x, mean.x, 1e-8);
    EXPECT_NEAR(through.mean2d.y, mean.y, 1e-8);
    const auto expected = flatten(A), actual = flatten(through.A);
    for (std::size_t k = 0; k < 6; ++k) EXPECT_NEAR(actual[k], expected[k], 1e-5);
  }
}

// ---- The whole of stage 1 for one Gaussian through a lens.

constexpr SplatSettings kLensSettings{.near_plane = 0.1f};

TEST(ProjectGaussian, GradientThroughEveryLensMatchesJetWithItsDepth) {
  for (const LensCase& lens : all_cases()) {
    PinholeCamera<double> camera = seeing(lens);
    LensVisits visits;
    const double worst = worst_flat_gradient_error(
        camera, kLensSettings,
        [&](TestRandom& random) {
          camera.cam_from_world_rotation = rotation_matrix(random.quaternion());
          camera.cam_from_world_translation = random.uniform3(-2, 2);
          for (;;) {
            const Vec3d p = draw_before(random, camera, visits);
            const Vec3d mean = multiply_transposed(camera.cam_from_world_rotation,
                                                   p - camera.cam_from_world_translation);
            const auto x = flatten(mean, random.uniform3(-4.5, -2.5), random.quaternion(),
                                   random.uniform(-3.0, 5.0));
            if (project_flat(camera, kLensSettings, x).is_visible) return x;
          }
        },
        500);
    EXPECT_LT(worst, 1e-8) << lens.label;
  }
}

/// Parallel rays: pixel = F (x, y) + c, as gsplat's "ortho" has it.
PinholeCamera<double> orthographic_camera() {
  PinholeCamera<double> camera{320, 240, 60, 50, 158, 122};
  camera.lens = endless_lens<double>(Lens::orthographic);
  return camera;
}

double apart(const Vec3d& a, const Vec3d& b) { return std::sqrt(inner(a - b, a - b)); }

TEST(ProjectThroughLens, OrthographicIsTheSameAtEveryDepth) {
  PinholeCamera<double> camera = orthographic_camera();
  TestRandom random;
  for (int i = 0; i < 200; ++i) {
    camera.cam_from_world_rotation = rotation_matrix(random.quaternion());
    const Vec3d p = random.uniform3(-3, 3);
    const ProjectedPoint<double> at = project_through_lens(camera, p);
    EXPECT_EQ(at.mean2d.x, 60 * p.x + 158);
    EXPECT_EQ(at.mean2d.y, 50 * p.y + 122);
    const Mat3<double>& W = camera.cam_from_world_rotation;
    EXPECT_LT(apart(at.A.row0, 60.0 * W.row0), 1e-13);
    EXPECT_LT(apart(at.A.row1, 50.0 * W.row1), 1e-13);
    const Vec3d g = project_through_lens_vjp(camera, p, Vec2d(2, 3), at.A);
    EXPECT_LT(apart(g, Vec3d(120, 150, 0)), 1e-13);
  }
  EXPECT_TRUE(is_in_sight(camera, {500, -80, 1}));
  EXPECT_FALSE(is_in_sight(camera, {0, 0, -1}));
}

// What has left the picture does not come back, however far beside the lens it is.
TEST(ProjectThroughLens, NeverFoldsBackIntoThePicture) {
  for (const LensCase& lens : all_cases()) {
    const PinholeCamera<double> camera = seeing(lens);
    const bool has_angles = has_angle_chart(camera.lens.lens);
    const double most = has_angles ? std::min(1.15 * camera.lens.radius, 3.04) : 1.5;
    for (int direction = 0; direction < 48; ++direction) {
      const double turn = 2 * pi * direction / 48;
      bool has_left = false;
      for (double theta = 0.01; theta < most; theta += 0.005) {
        const Vec3d p{std::sin(theta) * std::cos(turn), std::sin(theta) * std::sin(turn),
                      std::cos(theta)};
        const Vec2d at = project_through_lens(camera, p).mean2d;
        const bool is_inside = at.x > 0 && at.y > 0 && at.x < camera.width && at.y < camera.height;
        ASSERT_FALSE(has_left && is_inside) << lens.label << ", " << theta << " at " << turn;
        has_left |= !is_inside;
      }
    }
  }
}

/// A small Gaussian at an angle from the axis of a camera that sees 95 degrees to each side.
ProjectedGaussian<double> seen_at(double theta, double distance = 2) {
  const PinholeCamera<double> camera = seeing(wide_cases()[0]);
  return project_shape(camera, Vec3d(0, distance * std::sin(theta), distance * std::cos(theta)),
                       Vec3d(-4.0), Quat<double>{1, 0, 0, 0}, 2.0, 0.0, {});
}

TEST(ProjectGaussian, IsVisibleBesideAFisheyeAndNotBehindIt) {
  const double radius = seeing(wide_cases()[0]).lens.radius;  // that of its corners
  EXPECT_NEAR(radius, std::sqrt(2.0) * 160 / 96.5, 1e-9);
  EXPECT_TRUE(seen_at(94 * pi / 180).is_visible);
  EXPECT_TRUE(seen_at(1.14 * radius).is_visible);
  EXPECT_FALSE(seen_at(1.16 * radius).is_visible);
  EXPECT_FALSE(seen_at(179 * pi / 180).is_visible);
  EXPECT_NEAR(seen_at(94 * pi / 180).depth, 2, 1e-12);   // along the ray
  EXPECT_FALSE(seen_at(94 * pi / 180, 0.1).is_visible);  // nearer than the near plane
}

// A pixel of an equidistant fisheye covers sin(theta) / theta of what one on the axis does.
TEST(ProjectGaussian, CoversTheSameSolidAngleWhereverAFisheyeLooks) {
  const PinholeCamera<double> camera = seeing(wide_cases()[0]);
  const auto solid_angle = [&](double theta) {
    const Vec3d p(0, 2 * std::sin(theta), 2 * std::cos(theta));
    const Mat23<double> A = project_through_lens(camera, p).A;
    constexpr double v = 0.01;  // variance
    const double pixels = std::sqrt(determinant(project_covariance(A, {v, 0, 0, v, 0, v}, 0.0)));
    return pixels * (theta > 0 ? std::sin(theta) / theta : 1);
  };
  for (const double degrees : {1.0, 30.0, 60.0, 90.0, 120.0}) {
    EXPECT_NEAR(solid_angle(degrees * pi / 180), solid_angle(0), 1e-9 * solid_angle(0)) << degrees;
    EXPECT_NEAR(seen_at(degrees * pi / 180).depth, 2, 1e-12);  // the order does not change, either
  }
}

// Three standard deviations that reach the ray straight back would wrap around it.
TEST(ProjectGaussian, IsInvisibleWhereItReachesTheRayStraightBack) {
  const PinholeCamera<double> camera = seeing(wide_cases()[0]);
  const auto is_visible = [&](double size) {
    return project_shape(camera, Vec3d(0, 2, 0), Vec3d(std::log(size)), Quat<double>{1, 0, 0, 0},
                         2.0, 0.0, {})
        .is_visible;
  };
  const double limit = 2 * pi / 2 / 3;  // 90 degrees are left, at a distance of 2
  EXPECT_TRUE(is_visible(0.99 * limit));
  EXPECT_FALSE(is_visible(1.01 * limit));
}

}  // namespace
}  // namespace gs
