// SPDX-License-Identifier: Apache-2.0
// Small motions of cameras, and the gradient of a splat by its camera.
#include "gs_core/math/pose/pose.h"

#include "gs_core/geometry/vectors.h"
#include "gs_core/math/pose/camera_gradient.h"
#include "gs_core/math/render/rotation.h"
#include "tests/support/jet_oracle.h"

namespace gs {
namespace {

PinholeCamera<double> draw_posed_camera(TestRandom& random) {
  return {640,
          420,
          random.uniform(300.0, 900.0),
          random.uniform(300.0, 900.0),
          random.uniform(200.0, 440.0),
          random.uniform(130.0, 290.0),
          rotation_matrix(random.quaternion()),
          random.uniform3(-2.0, 2.0)};
}

template <class T>
RigidFrame<T> frame_as(const RigidFrame<double>& frame) {
  return {{Vec3<T>(frame.axes.row0), Vec3<T>(frame.axes.row1), Vec3<T>(frame.axes.row2)},
          Vec3<T>(frame.pivot)};
}

RigidFrame<double> frame_of(const PinholeCamera<double>& camera) {
  return {camera.cam_from_world_rotation, camera.position()};
}

/// Turns on both sides of the angle below which they are series, and far beyond what is refined.
Vec3d draw_turn(TestRandom& random) {
  const double size = std::pow(10.0, random.uniform(-5.0, 0.3));
  return random.uniform3(-size, size);
}

TEST(Rotation, OfAVectorTurnsAboutItByItsLength) {
  TestRandom random;
  for (int i = 0; i < kJetCases; ++i) {
    const Vec3d w = draw_turn(random);
    const double half = 0.5 * std::sqrt(inner(w, w)), s = std::sin(half) / (2 * half);
    const Mat3<double> R = rotation_matrix(Quat<double>{std::cos(half), s * w.x, s * w.y, s * w.z});
    const Mat3<double> E = rotation_minus_identity(w);
    const auto actual = flatten(E), expected = flatten(R);
    for (std::size_t k = 0; k < 9; ++k)
      EXPECT_NEAR(actual[k] + (k % 4 == 0), expected[k], 1e-13) << i;
  }
}

TEST(Pose, OfNoMotionStaysAsItIs) {
  TestRandom random;
  const PinholeCamera<double> camera = draw_posed_camera(random);
  const auto same = moved(camera, frame_of(camera), {Vec3d(0.0), Vec3d(0.0)});
  EXPECT_EQ(flatten(same.cam_from_world_rotation), flatten(camera.cam_from_world_rotation));
  EXPECT_LT(length(same.position() - camera.position()), 1e-15);
}

TEST(Pose, OfACameraTurnsAboutItsCenterInItsOwnAxes) {
  TestRandom random;
  const PinholeCamera<double> camera = draw_posed_camera(random);
  // A turn to the right, about the axis that points down: what was ahead is now to the left.
  const auto turned = moved(camera, frame_of(camera), {{0, 0.1, 0}, Vec3d(0.0)});
  EXPECT_LT(length(turned.position() - camera.position()), 1e-14);
  const Vec3d ahead =
      camera.position() + multiply_transposed(camera.cam_from_world_rotation, Vec3d(0, 0, 1));
  const Vec3d seen = to_camera(turned, ahead);
  EXPECT_NEAR(std::abs(std::atan2(seen.x, seen.z)), 0.1, 1e-12);
  EXPECT_NEAR(seen.y, 0, 1e-14);
  // A shift along the axis of sight.
  const auto shifted = moved(camera, frame_of(camera), {Vec3d(0.0), {0, 0, 0.25}});
  EXPECT_NEAR(to_camera(shifted, ahead).z, 0.75, 1e-13);
}

TEST(Pose, OfARigMovesItsCamerasAsOne) {
  TestRandom random;
  const PinholeCamera<double> a = draw_posed_camera(random), b = draw_posed_camera(random);
  const RigidFrame<double> frame{a.cam_from_world_rotation, (a.position() + b.position()) * 0.5};
  const RigidMotion<double> motion{{0.02, -0.03, 0.05}, {0.1, 0.2, -0.1}};
  // What one camera sees of the other stays the same.
  const auto b_in_a = [&](const PinholeCamera<double>& of_a, const PinholeCamera<double>& of_b) {
    return to_camera(of_a, of_b.position());
  };
  const Vec3d before = b_in_a(a, b),
              after = b_in_a(moved(a, frame, motion), moved(b, frame, motion));
  EXPECT_LT(length(after - before), 1e-14);
}

/// A Gaussian with all SH coefficients, as a camera sees it.
struct SeenGaussian {
  PinholeCamera<double> camera;
  Vec3d mean, sh0;
  Sym3<double> sigma;
  std::array<Vec3d, kShRestCount> sh_rest;
  double opacity;
  SplatSettings settings;
};

SeenGaussian draw_seen(TestRandom& random) {
  SeenGaussian seen;
  seen.camera = draw_posed_camera(random);
  seen.settings.antialias = random.chance(0.5);
  seen.settings.antialias_detach = false;
  const double z = random.uniform(0.5, 6.0);
  const Vec3d p{z * random.uniform(-1.5, 1.5), z * random.uniform(-1.0, 1.0), z};
  seen.mean = multiply_transposed(seen.camera.cam_from_world_rotation,
                                  p - seen.camera.cam_from_world_translation);
  const Vec3d s = random.uniform3(-4.0, -1.5);
  seen.sigma = covariance(rotation_matrix(random.quaternion()), variance(s));
  seen.opacity = random.uniform(0.2, 0.9);
  for (Vec3d& c : seen.sh_rest) c = random.uniform3(-0.3, 0.3);
  return seen;
}

template <class T>
std::array<T, 9> splat_of(const SeenGaussian& seen, const PinholeCamera<T>& camera) {
  const Sym3<double>& S = seen.sigma;
  const Sym3<T> sigma{T(S.xx), T(S.xy), T(S.xz), T(S.yy), T(S.yz), T(S.zz)};
  std::array<Vec3<T>, kShRestCount> sh_rest;
  for (std::size_t k = 0; k < sh_rest.size(); ++k) sh_rest[k] = Vec3<T>(seen.sh_rest[k]);
  const Vec3<T> mean(seen.mean);
  const auto projected =
      project_ellipsoid(camera, to_camera(camera, mean), sigma, T(seen.opacity), seen.settings);
  const Vec3<T> color = sh_color(seen.settings.sh_degree, unit_direction(camera.position(), mean),
                                 Vec3<T>(seen.sh0), sh_rest.data());
  return flatten(projected.splat.mean2d, projected.splat.conic, projected.splat.opacity, color);
}

TEST(CameraGradient, OfASplatMatchesJetThroughTheMotion) {
  SeenGaussian seen;
  RigidFrame<double> frame;  // of the camera, or of its rig
  const auto draw = [&](TestRandom& random) {
    seen = draw_seen(random);
    frame = frame_of(seen.camera);
    if (random.chance(0.5)) frame = {rotation_matrix(random.quaternion()), random.uniform3(-2, 2)};
    return flatten(random.uniform3(-0.02, 0.02), random.uniform3(-0.05, 0.05));
  };
  const auto forward = [&](const auto& x) {
    using T = std::decay_t<decltype(x[0])>;
    Unflatten in(x);
    const Vec3<T> turn = in.vec3(), shift = in.vec3();
    return splat_of<T>(seen, moved(camera_as<T>(seen.camera), frame_as<T>(frame), {turn, shift}));
  };
  const auto vjp = [&](const std::array<double, 6>& x, const std::array<double, 9>& dL_dy) {
    Unflatten in(x);
    const Vec3d turn = in.vec3(), shift = in.vec3();
    const RigidMotion<double> motion{turn, shift};
    const auto camera = moved(seen.camera, frame, motion);
    const auto dL_dsplat = splat_gradient(dL_dy);
    Vec3d unused[kShRestCount];
    const GaussianParameters<double> colors{{}, {}, {}, {}, seen.sh0, seen.sh_rest.data()};
    const Vec3d by_color =
        color_splat_vjp(camera, seen.mean, colors, seen.settings, dL_dsplat.color, unused).mean;
    const RigidMotion<double> dL = moved_vjp(seen.camera, frame, motion,
                                             camera_vjp(camera, seen.mean, seen.sigma, seen.opacity,
                                                        seen.settings, dL_dsplat, by_color));
    return flatten(dL.turn, dL.shift);
  };
  EXPECT_LT(worst_gradient_error(forward, vjp, draw), 1e-8);
}

}  // namespace
}  // namespace gs
