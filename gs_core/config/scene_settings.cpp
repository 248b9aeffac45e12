// SPDX-License-Identifier: Apache-2.0
#include "gs_core/config/scene_settings.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "gs_core/config/config_limits.h"
#include "gs_core/config/text/region_text.h"
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

// Points are few where walls are blank, and photos show how much there is to draw.
double gaussians_by_pixels(const DensityConfig& density, const SceneNumbers& scene) {
  if (density.pixels_per_gaussian == 0 || scene.points == 0) return 0;
  const double inside = double(scene.points - scene.points_outside) / double(scene.points);
  return inside * scene.pixels / double(density.pixels_per_gaussian);
}

}  // namespace

Config resolved_config(Config config, const SceneNumbers& scene) {
  const bool has_random_start = scene.points == 0 && config.model.start_from.empty();
  if (config.train.iterations == 0)
    config.train.iterations = steps_for(config.train, scene.photos, has_random_start);
  DensityConfig& density = config.density;
  if (density.gaussians_per_point > 0 && density.max_gaussians == 0) {
    const double starts =
        scene.points == 0 ? double(config.model.random_points) : double(scene.points);
    const double outside = double(scene.points_outside);
    const double grown = std::max(double(density.gaussians_per_point) * (starts - outside),
                                  gaussians_by_pixels(density, scene));
    const double most = std::min(grown + outside, std::max(kMostByPoints, starts));
    density.max_gaussians = std::max<std::int64_t>(1, std::llround(most));
  }
  return config;
}

Config resolved_config(Config config, const Scene& scene) {
  SceneNumbers numbers{scene.points.size(), scene.train_views.size()};
  for (const View& view : scene.train_views)
    numbers.pixels += double(view.camera.width) * double(view.camera.height);
  numbers.points_outside = points_outside(scene, region_of(config.density, scene.world_offset));
  return resolved_config(std::move(config), numbers);
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
  now.density.pixels_per_gaussian = run.density.pixels_per_gaussian;
  return now;
}

}  // namespace gs
