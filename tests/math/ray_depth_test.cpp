// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/render/ray_depth.h"

#include "tests/support/numbers.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

constexpr double kRounding = 1e-8;

/// Its rotation is exact, unlike that of a camera in float.
PinholeCamera<double> random_camera_in_double(TestRandom& random) {
  PinholeCamera<double> camera = camera_as<double>(random_camera(200, 150));
  camera.cam_from_world_rotation = rotation_matrix(random.quaternion());
  return camera;
}

/// A Gaussian in front of a camera; its thinnest axis has a share of the longest one's length.
GaussianParameters<double> random_gaussian(TestRandom& random, const PinholeCamera<double>& camera,
                                           double thinnest) {
  const double z = random.uniform(1, 6);
  const Vec3d p{random.uniform(-0.5, 0.5) * z, random.uniform(-0.5, 0.5) * z, z};
  GaussianParameters<double> gaussian{};
  gaussian.mean =
      multiply_transposed(camera.cam_from_world_rotation, p - camera.cam_from_world_translation);
  gaussian.log_scale = {0.0, random.uniform(std::log(thinnest), 0.0), std::log(thinnest)};
  gaussian.log_scale += Vec3d(random.uniform(-3, 1));
  gaussian.rotation = random.quaternion();
  return gaussian;
}

/// The ray of a pixel in world axes, of depth 1.
Vec3d ray_of(const PinholeCamera<double>& camera, const Vec2<double>& pixel) {
  return multiply_transposed(
      camera.cam_from_world_rotation,
      Vec3d((pixel.x - camera.cx) / camera.fx, (pixel.y - camera.cy) / camera.fy, 1));
}

/// (r - m)^T Sigma^-1 (r - m) of the point at depth t of a ray.
double distance2(const PinholeCamera<double>& camera, const GaussianParameters<double>& gaussian,
                 const Vec3d& ray, double t) {
  const Vec3d d = camera.position() + t * ray - gaussian.mean;
  const Vec3d along = multiply_transposed(rotation_matrix(gaussian.rotation), d);
  const Vec3d v = filtered_variance(variance(gaussian.log_scale), gaussian.filter_scale);
  return along.x * along.x / v.x + along.y * along.y / v.y + along.z * along.z / v.z;
}

TEST(RayDepth, IsWhereTheGaussianIsLargestOnTheRay) {
  TestRandom random;
  for (int k = 0; k < 2000; ++k) {
    const PinholeCamera<double> camera = random_camera_in_double(random);
    GaussianParameters<double> gaussian = random_gaussian(random, camera, 0.01);
    if (k % 2) gaussian.filter_scale = random.uniform(0, 1);
    const RayDepth<double> depth = ray_depth(camera, gaussian);
    const Vec2<double> mean2d = project_mean(camera, to_camera(camera, gaussian.mean));
    const double dx = random.uniform(-90, 90), dy = random.uniform(-90, 90);
    const Vec3d ray = ray_of(camera, mean2d + Vec2<double>(dx, dy));
    const double t = depth.at(dx, dy);
    // The parabola of the squared distance has its least value there.
    const auto value = [&](double at) { return distance2(camera, gaussian, ray, at); };
    const double curvature = value(t + 1) + value(t - 1) - 2 * value(t);
    EXPECT_NEAR((value(t + 1) - value(t - 1)) / curvature, 0, kRounding * (1 + std::abs(t))) << k;
  }
}

TEST(RayDepth, OfAFlatGaussianIsThatOfItsPlane) {
  TestRandom random;
  for (int k = 0; k < 200; ++k) {
    const PinholeCamera<double> camera = random_camera_in_double(random);
    GaussianParameters<double> gaussian = random_gaussian(random, camera, 1);
    const Vec3d normal = multiply(rotation_matrix(gaussian.rotation), Vec3d(0, 0, 1));
    gaussian.log_scale.z -= 100;  // counts as kLeastThickness of the length
    const Vec2<double> mean2d = project_mean(camera, to_camera(camera, gaussian.mean));
    const double slant = inner(normal, ray_of(camera, mean2d));
    if (std::abs(slant) < 0.3) continue;
    const Vec2<double> d{random.uniform(-10, 10), random.uniform(-10, 10)};
    const double expected = inner(normal, gaussian.mean - camera.position()) /
                            inner(normal, ray_of(camera, mean2d + d));
    EXPECT_NEAR(ray_depth(camera, gaussian).at(d.x, d.y), expected, 1e-4 * expected) << k;
  }
}

// Depths along one ray have a factor that depends on the camera, so that their order does not.
TEST(RayDepth, TimesTheLengthOfTheRayStaysWhenTheCameraTurns) {
  TestRandom random;
  int seen = 0;
  for (int k = 0; k < 500; ++k) {
    const PinholeCamera<double> camera = random_camera_in_double(random);
    const Mat3<double> turn = rotation_matrix(Quat<double>{
        1, random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2)});
    PinholeCamera<double> turned = camera;
    const Mat3<double>& W = camera.cam_from_world_rotation;
    const auto row = [&](const Vec3d& r) { return W.row0 * r.x + W.row1 * r.y + W.row2 * r.z; };
    turned.cam_from_world_rotation = {row(turn.row0), row(turn.row1), row(turn.row2)};
    turned.cam_from_world_translation = multiply(turn, camera.cam_from_world_translation);
    const GaussianParameters<double> gaussian = random_gaussian(random, camera, 1e-3);
    const auto distance = [&](const PinholeCamera<double>& view, const Vec3d& direction) {
      const Vec3d p = to_camera(view, view.position() + direction);
      const Vec2<double> d =
          project_mean(view, p) - project_mean(view, to_camera(view, gaussian.mean));
      return ray_depth(view, gaussian).at(d.x, d.y) / p.z;
    };
    const Vec3d direction = ray_of(camera, {random.uniform(0, 200), random.uniform(0, 150)});
    if (to_camera(turned, turned.position() + direction).z < 0.1 ||
        to_camera(turned, gaussian.mean).z < 0.1)
      continue;
    ++seen;
    const double here = distance(camera, direction);
    EXPECT_NEAR(distance(turned, direction), here, kRounding * std::max(std::abs(here), 1.0)) << k;
  }
  EXPECT_GT(seen, 400);
}

TEST(RayDepth, IsFiniteForPointsAndPlanesWithoutThickness) {
  const Camera camera = random_camera(200, 150);
  for (const Vec3f& log_scale :
       {Vec3f(-INFINITY), Vec3f(-1, -INFINITY, -2), Vec3f(-100), Vec3f(30)}) {
    GaussianParameters<float> gaussian{};
    gaussian.mean = behind_pixel(camera, 80, 70, 3);
    gaussian.log_scale = log_scale;
    gaussian.rotation = {1, 0.2f, 0.3f, 0.4f};
    EXPECT_NEAR(ray_depth(camera, gaussian).at(0, 0), 3, 1e-5);
    EXPECT_TRUE(std::isfinite(ray_depth(camera, gaussian).at(20, -10)));
  }
}

}  // namespace
}  // namespace gs
