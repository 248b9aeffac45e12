// SPDX-License-Identifier: Apache-2.0
// The gradient of the whole pipeline by a camera's pose, in float and by tiles, equals the slope of
// the brute-force picture in double.
#include "gs_render/renderer.h"
#include "gs_render/stages.h"
#include "tests/stages/slopes.h"

namespace gs {
namespace {

using Numbers = std::array<double, 6>;

RigidMotion<double> motion_of(const Numbers& x) { return {{x[0], x[1], x[2]}, {x[3], x[4], x[5]}}; }

/// Gaussians before a camera that its frame has moved a little.
struct Case {
  Camera given = slope_camera();
  Numbers motion{0.01, -0.02, 0.015, 0.03, -0.02, 0.04};
  RenderSettings settings;
  Gaussians gaussians = random_gaussians(kTypical, 9, given, 21);
  std::vector<float> weights = loss_weights(9);

  RigidFrame<double> frame() const {
    const auto camera = camera_as<double>(given);
    return {camera.cam_from_world_rotation, camera.position()};
  }
  PinholeCamera<double> camera(const Numbers& x) const {
    return moved(camera_as<double>(given), frame(), motion_of(x));
  }
};

CameraGradient<double> pipeline_gradient(const Case& scene) {
  const Camera camera = camera_as<float>(scene.camera(scene.motion));
  const auto renderer = make_scalar_renderer();
  RenderPass pass;
  renderer->forward(scene.gaussians.span(), camera, scene.settings, pass);
  const Buffer<float> dL_dimage = uploaded(scene.weights);
  Gaussians gradients = rows_like(scene.gaussians, scene.gaussians.count(), host_memory());
  Buffer<Vec2f> dL_dmean2d;
  dL_dmean2d.resize(scene.gaussians.count());
  renderer->backward(scene.gaussians.span(), camera, scene.settings, pass, dL_dimage.span(),
                     gradients.span(), dL_dmean2d.span());
  return camera_gradient(scene.gaussians.span(), camera, scene.settings, pass);
}

double reference_loss(const Case& scene, const Numbers& x, std::uint64_t& decisions) {
  const ReferencePicture picture = reference_picture(
      reference_splats<double>(in_double(scene.gaussians), scene.camera(x), scene.settings),
      scene.settings, kWidth, kHeight);
  decisions = picture.decisions();
  return linear_loss(scene.weights, picture.planes());
}

/// A splat's faint edge may move over a pixel center: its last contribution is 1/255 of a color. So
/// the step is as small as rounding allows, and is made smaller where decisions change.
double slope(const Case& scene, std::size_t k) {
  for (double h = 1e-6; h > 1e-9; h /= 4) {
    Numbers above = scene.motion, below = scene.motion;
    above[k] += h;
    below[k] -= h;
    std::uint64_t high_decisions, low_decisions;
    const double high = reference_loss(scene, above, high_decisions),
                 low = reference_loss(scene, below, low_decisions);
    if (high_decisions == low_decisions) return (high - low) / (2 * h);
  }
  ADD_FAILURE() << "number " << k << " lies on an edge";
  return 0;
}

void expect_slopes(const Case& scene) {
  const RigidMotion<double> dL = moved_vjp(camera_as<double>(scene.given), scene.frame(),
                                           motion_of(scene.motion), pipeline_gradient(scene));
  const Numbers gradient{dL.turn.x, dL.turn.y, dL.turn.z, dL.shift.x, dL.shift.y, dL.shift.z};
  double largest = 0;
  Numbers slopes;
  for (std::size_t k = 0; k < 6; ++k) {
    slopes[k] = slope(scene, k);
    largest = std::max(largest, std::abs(slopes[k]));
  }
  for (std::size_t k = 0; k < 6; ++k)  // floats round at 6e-8, and terms of all Gaussians cancel
    EXPECT_NEAR(gradient[k] / largest, slopes[k] / largest, 5e-5) << "number " << k;
}

TEST(CameraGradient, IsTheSlopeInEveryScene) {
  for (const SceneChange& change : kSceneChanges) {
    SCOPED_TRACE(change.name);
    Case scene;
    change.apply(scene.given, scene.settings, scene.gaussians);
    expect_slopes(scene);
  }
}

TEST(CameraGradient, HasTheSameBitsWithAnyNumberOfThreads) {
  Case scene;
  scene.gaussians = random_gaussians(kTypical, 3000, scene.given, 5);
  const auto gradient = [&] { return pipeline_gradient(scene); };
  const CameraGradient<double> one = with_threads(1, gradient);
  for (const int threads : {2, 7}) {
    const CameraGradient<double> other = with_threads(threads, gradient);
    EXPECT_EQ(other.turn, one.turn);
    EXPECT_EQ(other.center, one.center);
  }
}

}  // namespace
}  // namespace gs
