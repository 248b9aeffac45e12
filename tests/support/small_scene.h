// SPDX-License-Identifier: Apache-2.0
// A small scene for whole runs, rendered from known Gaussians.
#pragma once

#include "gs_core/scene.h"
#include "gs_render/renderer.h"
#include "tests/support/adaptive.h"
#include "tests/support/scenes.h"

namespace gs {

/// A camera at 3 units from the origin that looks at it, `turn` radians around the y axis.
inline Camera orbit_camera(float turn) {
  Camera camera;
  camera.width = 48;
  camera.height = 36;
  camera.fx = camera.fy = 50;
  camera.cx = 24;
  camera.cy = 18;
  const float c = std::cos(turn), s = std::sin(turn);
  camera.cam_from_world_rotation = {{c, 0, s}, {0, 1, 0}, {-s, 0, c}};
  camera.cam_from_world_translation = {0, 0, 3};
  return camera;
}

/// Forty colored Gaussians.
inline Gaussians small_truth(std::vector<ScenePoint>* points = nullptr) {
  Draws draws(1);
  Gaussians truth(40, host_memory());
  for (std::size_t i = 0; i < truth.count(); ++i) {
    const Vec3f place = draws.uniform3(-0.8f, 0.8f);
    draw_gaussian(truth, i, place, 0.05f, 0.25f, draws);
    const Vec3f near = place + draws.uniform3(-0.1f, 0.1f);
    if (points) points->push_back({near, {128, 128, 128}});
  }
  return truth;
}

/// Eight views around the Gaussians; the points to start from are near them, and gray.
inline Scene small_scene() {
  Scene scene;
  scene.source = "a scene of the test";
  const Gaussians truth = small_truth(&scene.points);
  const auto renderer = make_scalar_renderer();
  RenderPass pass;
  for (int k = 0; k < 8; ++k) {
    const Camera camera = orbit_camera(0.785f * float(k));
    renderer->forward(truth.span(), camera, {}, pass);
    scene.train_views.push_back({"view " + std::to_string(k), camera, to_image8(image_of(pass))});
  }
  scene.extent = camera_extent(scene.train_views);
  return scene;
}

/// Views of random cameras, with photos of noise.
inline std::vector<View> random_views(std::size_t count, int width, int height) {
  std::vector<View> views;
  for (std::uint64_t seed = 1; seed <= count; ++seed)
    views.push_back({"view " + std::to_string(seed), random_camera(width, height, seed),
                     random_photo(width, height, seed)});
  return views;
}

/// The small scene twice, far above each other. Each photo shows one half, as do photos of a city.
inline Scene scene_of_two_halves() {
  const Vec3f up(0, 10, 0);
  Scene scene = small_scene();
  const std::vector<ScenePoint> points = scene.points;
  for (ScenePoint point : points) {
    point.position += up;
    scene.points.push_back(point);
  }
  const std::vector<View> views = scene.train_views;
  for (View view : views) {
    view.name += " above";
    view.camera.cam_from_world_translation -= up;  // they turn around it
    scene.train_views.push_back(view);
  }
  scene.extent = camera_extent(views);
  return scene;
}

/// 250 steps, with rates that are high enough for such a short run.
inline Config short_run() {
  Config config = adaptive_config();
  config.train.iterations = 250;
  config.optimizer.position_lr_initial = 1e-3f;
  config.optimizer.log_scale_lr = 0.02f;
  config.optimizer.sh0_lr = 0.02f;
  return config;
}

/// A short run of so many steps, with a refinement every 20 in which much grows.
inline Config growing_run(int steps) {
  Config config = short_run();
  config.train.iterations = steps;
  config.density.from_step = config.density.every = 20;
  config.density.gradient_threshold = 1e-5f;
  return config;
}

/// The same run where the Gaussians are known and stay, but for their colors.
inline Config of_known_shape(Config config) {
  for (float* rate : {&config.optimizer.position_lr_initial, &config.optimizer.position_lr_final,
                      &config.optimizer.log_scale_lr, &config.optimizer.rotation_lr,
                      &config.optimizer.opacity_lr})
    *rate = 1e-9f;
  return config;
}

/// A short run under MCMC, with initial scales from the points; it starts with half of its
/// Gaussians.
inline Config short_mcmc_run() {
  Config config = short_run();
  config.density.strategy = "mcmc";
  config.density.max_gaussians = 80;
  config.density.from_step = config.density.every = 20;
  config.density.until_step = 24900;
  config.density.growth = 0.2f;
  config.model.initial_opacity = 0.5f;
  return config;
}

/// 130 steps up to 200 Gaussians, with a refinement every 20 steps in which much happens: of drawn
/// Gaussians the parents stay, and what no photo shows goes. Opacities are halved every 30.
inline Config busy_run() {
  Config config = short_run();
  config.train.iterations = 130;
  DensityConfig& density = config.density;
  density.strategy = "litegs";
  density.max_gaussians = 200;
  density.gradient_threshold = 0;
  density.from_step = density.every = 20;
  density.until_step = 24000;
  density.reset_opacity_every = 30;
  density.reset_opacity_until = 30000;
  return config;
}

}  // namespace gs
