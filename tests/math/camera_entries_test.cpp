// SPDX-License-Identifier: Apache-2.0
// Stage 7 by every entry of a camera, beside Jets of its sixteen numbers.
#include "gs_core/math/pose/camera_entries.h"

#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

constexpr int kWidth = 640, kHeight = 420;

// A camera is flatten(rotation, translation, fx, fy, cx, cy). Its rotation is any matrix near one.
template <class T>
PinholeCamera<T> camera_of(Unflatten<T, 16>& in) {
  const Mat3<T> rotation = in.mat3();
  const Vec3<T> translation = in.vec3();
  const T fx = in.scalar(), fy = in.scalar(), cx = in.scalar(), cy = in.scalar();
  return {kWidth, kHeight, fx, fy, cx, cy, rotation, translation};
}
template <class T>
PinholeCamera<T> camera_of(const std::array<T, 16>& flat) {
  Unflatten<T, 16> in(flat);
  return camera_of(in);
}

std::array<double, 16> draw_entries(TestRandom& random) {
  Mat3<double> rotation = rotation_matrix(random.quaternion());
  rotation.row0 += random.uniform3(-0.05, 0.05);
  rotation.row2 += random.uniform3(-0.05, 0.05);
  return flatten(rotation, random.uniform3(-2, 2), random.uniform(300, 900),
                 random.uniform(300, 900), kWidth * random.uniform(0.3, 0.7),
                 kHeight * random.uniform(0.3, 0.7));
}

std::array<double, 16> flat(const CameraEntriesGradient<double>& gradient) {
  return flatten(gradient.rotation, gradient.translation, gradient.fx, gradient.fy, gradient.cx,
                 gradient.cy);
}

TEST(CameraEntries, GradientIsThatOfJets) {
  TestRandom random;
  int inside = 0, beyond = 0;
  double worst = 0;
  for (int i = 0; i < kJetCases; ++i) {
    const std::array<double, 16> numbers = draw_entries(random);
    const PinholeCamera<double> camera = camera_of(numbers);
    const double z = random.uniform(0.3, 8);
    const Vec3d p{z * random.uniform(-1.8, 1.8), z * random.uniform(-1.8, 1.8), z};
    const Vec3d mean =
        multiply_transposed(camera.cam_from_world_rotation, p - camera.cam_from_world_translation);
    if (to_camera(camera, mean).z < 0.2) continue;  // the matrix is no rotation
    const Vec3d variances{random.uniform(1e-4, 0.1), random.uniform(1e-4, 0.1),
                          random.uniform(1e-4, 0.1)};
    const Sym3<double> sigma = covariance(rotation_matrix(random.quaternion()), variances);
    SplatSettings settings;
    settings.antialias = random.chance(0.5);
    settings.antialias_detach = false;
    const auto forward = [&]<class T>(const std::array<T, 16>& x) {
      const PinholeCamera<T> c = camera_of(x);
      const Vec3<T> mean_t(mean);
      const Sym3<T> sigma_t{T(sigma.xx), T(sigma.xy), T(sigma.xz),
                            T(sigma.yy), T(sigma.yz), T(sigma.zz)};
      const ProjectedGaussian<T> splat =
          project_ellipsoid(c, to_camera(c, mean_t), sigma_t, T(0.7), settings);
      return flatten(splat.splat.mean2d, splat.splat.conic, splat.splat.opacity, splat.depth);
    };
    auto dL_dy = forward(numbers);
    for (double& g : dL_dy) g = random.uniform(-1, 1);
    Unflatten in(dL_dy);
    BasicSplatGradient<double> dL_dsplat;
    dL_dsplat.mean2d = in.vec2();
    dL_dsplat.conic = gradient_matrix(in.sym2());
    dL_dsplat.opacity = in.scalar();
    dL_dsplat.depth = in.scalar();
    const auto dL = project_ellipsoid_in_camera_vjp(camera, to_camera(camera, mean), sigma, 0.7,
                                                    settings, dL_dsplat);
    const auto actual = flat(camera_entries_vjp(camera, mean, dL, dL_dsplat.mean2d));
    worst = std::max(worst, gradient_error(jet_gradient(forward, numbers, dL_dy), actual));
    const FrustumLimits<double> limits = frustum_limits(camera);
    const Vec3d seen = to_camera(camera, mean);
    const bool is_inside = seen.x / seen.z > limits.low.x && seen.x / seen.z < limits.high.x &&
                           seen.y / seen.z > limits.low.y && seen.y / seen.z < limits.high.y;
    ++(is_inside ? inside : beyond);
  }
  EXPECT_LT(worst, kJetTolerance);
  EXPECT_GT(inside, kEnoughCases);
  EXPECT_GT(beyond, kEnoughCases);
}

/// A lens whose range covers all that is drawn, so that both of its sides are tried.
CameraLens<double> lens_of(Lens kind) {
  CameraLens<double> lens;
  lens.lens = kind;
  lens.radius = kind == Lens::orthographic ? 1e9 : 1.2;
  lens.low = {-2, -2}, lens.high = {2, 2};
  if (kind == Lens::orthographic) return lens;
  lens.k[0] = -0.03, lens.k[1] = 0.01;
  lens.p[0] = 1e-3, lens.p[1] = -2e-3;
  return lens;
}

TEST(CameraEntries, GradientThroughALensIsThatOfJets) {
  for (const Lens kind : {Lens::radial_tangential, Lens::fisheye, Lens::orthographic}) {
    TestRandom random;
    double worst = 0;
    int seen = 0;
    for (int i = 0; i < kJetCases; ++i) {
      const std::array<double, 16> numbers = draw_entries(random);
      const auto camera_with = [&]<class T>(const std::array<T, 16>& x) {
        PinholeCamera<T> camera = camera_of(x);
        camera.lens = lens_as<T>(lens_of(kind));
        return camera;
      };
      const PinholeCamera<double> camera = camera_with(numbers);
      const double z = kind == Lens::fisheye ? random.uniform(-1, 3) : random.uniform(0.3, 3);
      const Vec3d mean = multiply_transposed(
          camera.cam_from_world_rotation, Vec3d(random.uniform(-2, 2), random.uniform(-2, 2), z) -
                                              camera.cam_from_world_translation);
      if (kind != Lens::fisheye && to_camera(camera, mean).z < 0.2) continue;
      const double v = random.uniform(1e-4, 0.02);
      const auto forward = [&]<class T>(const std::array<T, 16>& x) {
        const PinholeCamera<T> c = camera_with(x);
        const ProjectedGaussian<T> splat = project_ellipsoid(
            c, to_camera(c, Vec3<T>(mean)),
            Sym3<T>{T(2 * v), T(0.3 * v), T(0), T(v), T(0.1 * v), T(3 * v)}, T(0.7), {});
        return std::pair(splat.is_visible, flatten(splat.splat.mean2d, splat.splat.conic));
      };
      if (!forward(numbers).first) continue;
      ++seen;
      auto dL_dy = forward(numbers).second;
      for (double& g : dL_dy) g = random.uniform(-1, 1);
      Unflatten in(dL_dy);
      BasicSplatGradient<double> dL_dsplat;
      dL_dsplat.mean2d = in.vec2();
      dL_dsplat.conic = gradient_matrix(in.sym2());
      dL_dsplat.opacity = dL_dsplat.depth = 0;
      const auto dL = project_ellipsoid_in_camera_vjp(
          camera, to_camera(camera, mean), Sym3<double>{2 * v, 0.3 * v, 0, v, 0.1 * v, 3 * v}, 0.7,
          {}, dL_dsplat);
      const auto actual = flat(camera_entries_vjp(camera, mean, dL, dL_dsplat.mean2d));
      const auto of_picture = [&](const auto& x) { return forward(x).second; };
      worst = std::max(worst, gradient_error(jet_gradient(of_picture, numbers, dL_dy), actual));
    }
    EXPECT_LT(worst, 1e-8) << int(kind);
    EXPECT_GT(seen, kEnoughCases);
  }
}

TEST(CameraEntries, GradientThroughTheCenterIsThatOfJets) {
  TestRandom random;
  double worst = 0;
  for (int i = 0; i < kJetCases; ++i) {
    const std::array<double, 16> numbers = draw_entries(random);
    const PinholeCamera<double> camera = camera_of(numbers);
    const Vec3d mean = random.uniform3(-3, 3);
    const auto forward = [&]<class T>(const std::array<T, 16>& x) {
      return flatten(unit_direction(camera_of(x).position(), Vec3<T>(mean)));
    };
    const Vec3d dL_ddirection = random.uniform3(-1, 1);
    const Vec3d by_color = unit_direction_vjp(camera.position(), mean, dL_ddirection);
    worst = std::max(worst, gradient_error(jet_gradient(forward, numbers, flatten(dL_ddirection)),
                                           flat(camera_entries_by_color_vjp(camera, by_color))));
  }
  EXPECT_LT(worst, kJetTolerance);
}

}  // namespace
}  // namespace gs
