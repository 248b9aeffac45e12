// SPDX-License-Identifier: Apache-2.0
#include "gs_core/math/render/surface.h"

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

SplatSettings settings_of(bool antialias) {
  SplatSettings settings;
  settings.antialias = antialias;
  return settings;
}

/// A camera that looks along z, turned a little, as a function of the scalar.
template <class T>
PinholeCamera<T> camera_of() {
  PinholeCamera<T> camera{640, 480, T(500.0), T(520.0), T(310.0), T(250.0)};
  camera.cam_from_world_rotation = rotation_matrix(Quat<T>{T(0.95), T(0.1), T(-0.2), T(0.15)});
  camera.cam_from_world_translation = {T(0.3), T(-0.2), T(4.0)};
  return camera;
}

template <class T>
auto numbers(const SplatSurface<T>& surface) {
  return flatten(surface.at_axis, surface.slope, surface.normal);
}
template <class T>
GaussianShape<T> shape_from(Unflatten<T, 10>& in) {
  GaussianShape<T> shape;
  shape.mean = in.vec3();
  shape.log_scale = in.vec3();
  shape.rotation = in.quat();
  return shape;
}

/// Gaussians in front of the camera, from balls to sheets of a three hundredth of their width.
auto draw_shape(TestRandom& random) {
  Vec3d log_scale = random.uniform3(-3.0, -1.0);
  log_scale[int(random.uniform(0.0, 2.999))] -= random.uniform(0.0, 5.7);
  return flatten(random.uniform3(-1.0, 1.0), log_scale,
                 Quat<double>{random.uniform(0.2, 1.0), random.uniform(-1.0, 1.0),
                              random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0)});
}

TEST(Surface, GradientMatchesJet) {
  for (const double filter : {0.0, 0.02})
    for (const bool antialias : {false, true}) {
      const SplatSettings settings = settings_of(antialias);
      const double worst = worst_gradient_error(
          [&](const auto& x) {
            using T = typename std::remove_cvref_t<decltype(x)>::value_type;
            Unflatten in(x);
            return numbers(splat_surface(camera_of<T>(), shape_from(in), T(filter), settings));
          },
          [&](const auto& x, const auto& g) {
            Unflatten in(x);
            Unflatten by(g);
            SplatSurface<double> dL;
            dL.at_axis = by.scalar();
            dL.slope = by.vec2();
            dL.normal = by.vec3();
            const auto gradient =
                splat_surface_vjp(camera_of<double>(), shape_from(in), filter, settings, dL);
            return flatten(gradient.mean, gradient.log_scale, gradient.rotation);
          },
          draw_shape);
      // Sheets lose four of their digits in the conic.
      EXPECT_LT(worst, 100 * kJetTolerance) << filter << antialias;
    }
}

// A sheet through a point shows the plane in which it lies, also far beside its mean.
TEST(Surface, OfAFlatGaussianIsItsPlane) {
  const PinholeCamera<double> camera = camera_of<double>();
  TestRandom random;
  for (int i = 0; i < 200; ++i) {
    const GaussianShape<double> shape{
        random.uniform3(-1.0, 1.0),
        {-1.5, -1.2, -12.0},
        {1.0, random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5)}};
    const Mat3<double> R = rotation_matrix(shape.rotation);
    const Vec3d axis =
        multiply(camera.cam_from_world_rotation, Vec3d(R.row0.z, R.row1.z, R.row2.z));
    const Vec3d p = to_camera(camera, shape.mean);
    if (std::abs(inner(axis, p)) < 0.4 * std::sqrt(inner(p, p))) continue;  // the blur counts
    SplatSettings settings;
    settings.blur = 1e-9f;
    const SplatSurface<double> surface = splat_surface(camera, shape, 0.0, settings);
    EXPECT_NEAR(std::abs(inner(surface.normal, axis)), 1, 1e-6);
    EXPECT_LT(inner(surface.normal, p), 0);
    const Vec2<double> x{camera.fx * p.x / p.z + 40, camera.fy * p.y / p.z - 30};
    const Vec3d ray{x.x / camera.fx, x.y / camera.fy, 1.0};
    const double exact = inner(axis, ray) / inner(axis, p);
    EXPECT_NEAR((surface.at_axis + inner(surface.slope, x)) / exact, 1, 1e-5);
  }
}

}  // namespace
}  // namespace gs
