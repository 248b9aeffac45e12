// SPDX-License-Identifier: Apache-2.0
// A scene whose training photos have disturbed poses, for runs that refine them.
#pragma once

#include "tests/support/poses.h"
#include "tests/support/scene_run.h"

namespace gs {

inline constexpr std::size_t kPosedViews = 20, kHeldOut = 5;  // every fourth view is held out
inline constexpr double kDisturbedTurn = 0.5 * std::numbers::pi / 180, kDisturbedShift = 0.01;

struct PosedScene {
  Scene given, disturbed;     // the same but for the poses of training photos
  std::vector<Camera> truth;  // of training photos
};

/// A ball of Gaussians with colors of its own at each place.
inline Gaussians posed_truth(std::vector<ScenePoint>& points) {
  Draws draws(11);
  Gaussians truth(250, host_memory());
  for (std::size_t i = 0; i < truth.count(); ++i) {
    Vec3f place;
    do place = draws.uniform3(-1, 1);
    while (inner(place, place) > 1);
    const Vec3f color = draws.uniform3(0, 1);
    const float opacity = draws.uniform(0.6f, 0.97f);
    const float size = draws.uniform(0.05f, 0.16f);
    set_gaussian(truth, i, place, size, opacity, color);
    points.push_back(
        {place,
         {std::uint8_t(255 * color.x), std::uint8_t(255 * color.y), std::uint8_t(255 * color.z)}});
  }
  return truth;
}

/// An orbit that goes up and down, so that every direction is seen from several sides.
inline Camera posed_camera(std::size_t k) {
  const float turn = 2 * float(std::numbers::pi) * float(k) / float(kPosedViews);
  Camera camera = orbit_camera(turn);
  const float tilt = 0.5f * std::sin(3 * turn + 0.4f), c = std::cos(tilt), s = std::sin(tilt);
  const Mat3<float> W = camera.cam_from_world_rotation;
  camera.cam_from_world_rotation = {W.row0, c * W.row1 - s * W.row2, s * W.row1 + c * W.row2};
  return camera;
}

inline PosedScene posed_scene() {
  PosedScene scenes;
  Scene& given = scenes.given;
  given.source = "a scene of the test";
  const Gaussians truth = posed_truth(given.points);
  const auto renderer = make_scalar_renderer();
  RenderPass pass;
  for (std::size_t k = 0; k < kPosedViews; ++k) {
    const Camera camera = posed_camera(k);
    renderer->forward(truth.span(), camera, {}, pass);
    auto& views = k % (kPosedViews / kHeldOut) == 0 ? given.test_views : given.train_views;
    views.push_back({"view " + std::to_string(10 + k), camera, to_image8(image_of(pass))});
  }
  given.extent = camera_extent(given.train_views);
  for (const View& view : given.train_views) scenes.truth.push_back(view.camera);
  // What all photos have in common is no error of theirs.
  Config config = adaptive_config();
  config.poses.refine = true;
  TrainingModel model;
  begin_poses(config, given, model);
  disturb(model.poses, kDisturbedTurn, kDisturbedShift);
  take_out_modes(model.poses);
  scenes.disturbed = given;
  for (std::size_t i = 0; i < scenes.truth.size(); ++i)
    scenes.disturbed.train_views[i].camera =
        refined_camera(model.poses, given.train_views[i].camera, i);
  return scenes;
}

/// Short runs, in which no Gaussian is added.
inline constexpr int kPosedSteps = 6000;
inline Config posed_run(int steps) {
  Config config = adaptive_config();
  config.train.iterations = steps;
  config.model.sh_degree = 0;
  config.density.until_step = config.density.reset_opacity_until = 0;
  config.optimizer.sh0_lr = 0.01f;
  config.optimizer.moments = MomentStorage::floats;  // drawn photos are matched beyond half moments
  return config;
}
inline Config refining_run(int steps) {
  Config config = posed_run(steps);
  config.poses.refine = true;
  config.poses.rate = 1e-3f;  // as high as such a short run needs
  return config;
}

/// The same run where the Gaussians are known and stay, with their colors.
inline Config of_known_gaussians(Config config) {
  config.optimizer.sh0_lr = 1e-9f;
  return of_known_shape(config);
}

/// The Gaussians that the photos show, to start from.
inline TrainingState state_of_truth(const PosedScene& posed, const Config& config) {
  std::vector<ScenePoint> points;
  return state_of(posed_truth(points), posed.truth.size(), config);
}

}  // namespace gs
