// SPDX-License-Identifier: Apache-2.0
// A scene for photometric models: a wall whose photos are multiplied by known gains.
#pragma once

#include "gs_core/math/loss/photometric.h"
#include "tests/support/scene_run.h"

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

/// All photos of the wall; without gains unless `is_varied`.
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
    ImageF picture = image_of(pass);
    const Vec3f a = is_varied ? true_log_gain(k) : Vec3f(0);
    for (std::size_t i = 0; i < picture.pixels.size(); ++i)
      picture.pixels[i] = std::min(gained(picture.pixels[i], a[int(i % 3)]), 1.0f);
    scene.train_views.push_back({"view " + std::to_string(10 + k), camera, to_image8(picture)});
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
  Gaussians gray = wall();
  gray.sh0.fill_zero();
  return state_of(gray, kWallViews, config);
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
