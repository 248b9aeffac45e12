// SPDX-License-Identifier: Apache-2.0
// A scene for photometric models: a wall whose photos are multiplied by known gains.
#pragma once

#include <algorithm>
#include <cmath>

#include "gs_core/math/loss/photometric.h"
#include "gs_train/loop/checkpoint.h"
#include "gs_train/loop/view_sampler.h"
#include "tests/support/adaptive.h"
#include "tests/support/models.h"
#include "tests/support/small_scene.h"

namespace gs {

inline constexpr std::size_t kWallViews = 24;

/// Photo k shows exp(a) times the scene, with gains of up to half a stop. They jump from photo
/// to photo, as no color that changes with the direction does; and the mean of each channel is 0.
inline Vec3f true_log_gain(std::size_t k) {
  constexpr int kJumps[kWallViews] = {5, -3, 1, -5, 4, -1, 3, -4, 0,  2, 2,  -4,
                                      4, -2, 3, -5, 1, 0,  5, -3, -4, 2, -1, 0};
  const auto jump = [&](std::size_t i) { return 0.07f * float(kJumps[i % kWallViews]); };
  return {jump(k), jump(5 * k + 3), jump(7 * k + 1)};
}

/// A wall that fills the pictures to their corners, dark enough to be multiplied.
inline Gaussians wall() {
  Draws draws(5);
  Gaussians truth(400, host_memory());
  for (std::size_t i = 0; i < truth.count(); ++i) {
    Vec3f place = draws.uniform3(-3.2f, 3.2f);
    place.z *= 0.05f;
    const Vec3f color = draws.uniform3(0.05f, 0.5f);
    set_gaussian(truth, i, place, draws.uniform(0.15f, 0.35f), 0.95f, color);
  }
  return truth;
}

/// Each photo sees another part of the wall.
inline Camera wall_camera(std::size_t k) {
  Camera camera = orbit_camera(0.3f * (float(k) / float(kWallViews) - 0.5f));
  camera.cam_from_world_translation = {0.25f * float(int(7 * k % 5) - 2),
                                       0.3f * float(int(3 * k % 5) - 2), 4.5f};
  return camera;
}

/// The photo of what a camera sees; without gains unless `is_varied`.
inline Image8 wall_photo(const RenderPass& pass, const Camera& camera, std::size_t k,
                         bool is_varied) {
  const Vec3f a = is_varied ? true_log_gain(k) : Vec3f(0);
  Image8 photo(camera.width, camera.height, 3);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const std::size_t i = std::size_t(y) * std::size_t(camera.width) + std::size_t(x);
      for (int c = 0; c < 3; ++c) {
        const float value = gained(pass.image[std::size_t(c) * pass.pixel_count() + i], a[c]);
        photo.at(x, y, c) = std::uint8_t(std::lround(255 * std::min(value, 1.0f)));
      }
    }
  return photo;
}

/// All photos, as wall_photo() has them.
inline Scene wall_scene(bool is_varied) {
  Scene scene;
  scene.source = "a scene of the test";
  const Gaussians truth = wall();
  for (const Vec3f& mean : truth.mean) scene.points.push_back({mean, {70, 70, 70}});
  const auto renderer = make_scalar_renderer();
  RenderPass pass;
  for (std::size_t k = 0; k < kWallViews; ++k) {
    const Camera camera = wall_camera(k);
    renderer->forward(truth.span(), camera, {}, pass);
    scene.train_views.push_back(
        {"view " + std::to_string(10 + k), camera, wall_photo(pass, camera, k, is_varied)});
  }
  scene.extent = camera_extent(scene.train_views);
  return scene;
}

/// Gaussians stay as many as they are.
inline Config gains_run(int steps) {
  Config config = adaptive_config();
  config.train.iterations = steps;
  config.model.sh_degree = 0;
  config.density.until_step = config.density.reset_opacity_until = 0;
  config.photometric.model = "gains";
  config.photometric.rate = 0.02f;
  return config;
}

/// The wall in gray, to start from: colors and gains are to be found.
inline TrainingState gray_wall(const Config& config) {
  TrainingState state;
  state.model.store_moments_as(config.optimizer.moments);
  state.model.gaussians = wall();
  state.model.gaussians.sh0.fill_zero();
  clear_history(state.model);
  state.progress.strikes.assign(kWallViews, 0);
  ViewSampler views(kWallViews, config.train.seed);
  views.view_of(1);
  state.progress.view_order = {views.order().begin(), views.order().end()};
  return state;
}
/// The same run where the shape of the wall is known and stays.
inline Config of_known_shape(Config config) {
  for (float* rate : {&config.optimizer.position_lr_initial, &config.optimizer.position_lr_final,
                      &config.optimizer.log_scale_lr, &config.optimizer.rotation_lr,
                      &config.optimizer.opacity_lr})
    *rate = 1e-9f;
  return config;
}

/// The worst error of a gain.
inline double gain_error(const PhotometricState& state) {
  double worst = 0;
  for (std::size_t k = 0; k < kWallViews; ++k)
    for (std::size_t c = 0; c < 3; ++c)
      worst = std::max(worst, std::abs(double(state.row(k)[c] - true_log_gain(k)[int(c)])));
  return worst;
}

}  // namespace gs
