// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/scene_settings.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "gs_core/config/config_limits.h"
#include "gs_core/config/region_text.h"
#include "gs_core/scene.h"

namespace gs {
namespace {

constexpr double kMostByPoints = 1e7;  // dense clouds of a laser need no multiple of their points

int steps_for(const TrainConfig& train, std::size_t photos, bool has_random_start) {
  const double factor = has_random_start ? double(train.random_start_factor) : 1;
  const double most = std::max(1.0, factor * train.most_iterations);
  const double least = std::min(factor * train.least_iterations, most);
  const double steps =
      std::clamp(factor * train.epochs * double(photos), std::max(1.0, least), most);
  return int(std::lround(std::min(steps, limits::kLargestInt)));
}

std::size_t points_outside(const Scene& scene, const Region& region) {
  return std::size_t(std::ranges::count_if(
      scene.points, [&](const ScenePoint& point) { return !region.holds(point.position); }));
}

}  // namespace

Config settled_for(Config config, std::size_t points, std::size_t photos, std::size_t outside) {
  const bool has_random_start = points == 0 && config.model.start_from.empty();
  if (config.train.iterations == 0)
    config.train.iterations = steps_for(config.train, photos, has_random_start);
  DensityConfig& density = config.density;
  if (density.gaussians_per_point > 0 && density.max_gaussians == 0) {
    const double starts = points == 0 ? double(config.model.random_points) : double(points);
    const double grown = double(density.gaussians_per_point) * (starts - double(outside));
    const double most = std::min(grown + double(outside), std::max(kMostByPoints, starts));
    density.max_gaussians = std::max<std::int64_t>(1, std::llround(most));
  }
  return config;
}

Config settled_for(Config config, const Scene& scene) {
  const std::size_t outside = points_outside(scene, region_of(config.density, scene.world_offset));
  return settled_for(std::move(config), scene.points.size(), scene.train_views.size(), outside);
}

Config settled_as_in(const Config& run, Config now) {
  TrainConfig& train = now.train;
  if (train.iterations == 0) train.iterations = run.train.iterations;
  train.epochs = run.train.epochs;
  train.least_iterations = run.train.least_iterations;
  train.most_iterations = run.train.most_iterations;
  train.random_start_factor = run.train.random_start_factor;
  if (now.density.max_gaussians == 0 && run.density.gaussians_per_point > 0)
    now.density.max_gaussians = run.density.max_gaussians;
  now.density.gaussians_per_point = run.density.gaussians_per_point;
  return now;
}

}  // namespace gs
