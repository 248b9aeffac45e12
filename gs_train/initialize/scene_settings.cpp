// SPDX-License-Identifier: Apache-2.0
#include "gs_train/initialize/scene_settings.h"

#include <algorithm>
#include <cmath>

#include "gs_core/config/region_text.h"

namespace gs {
namespace {

double points_outside(const Scene& scene, const Region& region) {
  return double(std::ranges::count_if(
      scene.points, [&](const ScenePoint& point) { return !region.holds(point.position); }));
}

}  // namespace

Config settled_for(Config config, const Scene& scene) {
  TrainConfig& train = config.train;
  if (train.epochs > 0) {
    const std::int64_t steps = std::int64_t(train.epochs) * std::int64_t(scene.train_views.size());
    const std::int64_t most = train.iterations;
    train.iterations =
        int(std::clamp(steps, std::min<std::int64_t>(train.least_iterations, most), most));
  }
  train.epochs = train.least_iterations = 0;
  DensityConfig& density = config.density;
  if (density.gaussians_per_point > 0 && density.max_gaussians == 0) {
    const double points =
        scene.points.empty() ? double(config.model.random_points) : double(scene.points.size());
    const double outside = points_outside(scene, region_of(density, scene.world_offset));
    density.max_gaussians = std::max<std::int64_t>(
        1, std::llround(double(density.gaussians_per_point) * (points - outside) + outside));
  }
  density.gaussians_per_point = 0;
  return config;
}

Config settled_as_in(const Config& run, Config now) {
  if (now.train.epochs > 0) now.train.iterations = run.train.iterations;
  now.train.epochs = now.train.least_iterations = 0;
  if (now.density.gaussians_per_point > 0 && now.density.max_gaussians == 0)
    now.density.max_gaussians = run.density.max_gaussians;
  now.density.gaussians_per_point = 0;
  return now;
}

}  // namespace gs
