// SPDX-License-Identifier: Apache-2.0
#include "gs_train/initialize/initialize.h"

#include "gs_core/error.h"
#include "gs_core/geometry/kd_tree.h"
#include "gs_core/geometry/seen_pixel.h"
#include "gs_core/math/random.h"
#include "gs_core/math/render/splat.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/initialize/camera_center.h"
#include "gs_train/initialize/downsample_points.h"
#include "gs_train/initialize/looked_at.h"
#include "gs_train/photometric/photometric_start.h"
#include "gs_train/poses/poses.h"

namespace gs {
namespace {

constexpr float kExtentsOfBox = 3;  // half the edge of the box of random points around cameras

bool sees(const Camera& camera, const Vec3f& point, float near_plane) {
  const Vec3f p = to_camera(camera, point);
  return depth_of(camera, p) >= near_plane && is_in_sight(camera, p) &&
         holds_pixel(camera, pixel_of(camera, p));
}

struct Box {
  Vec3f center;
  float half;  // of its edges
};

// The box of random points: that of the config, or else around what the training cameras look at,
// or else around the cameras.
Box random_box(const Scene& scene, const Config& config) {
  if (config.model.random_box > 0) return {-Vec3f(scene.world_offset), config.model.random_box};
  if (const auto target = looked_at(scene.train_views)) return {target->center, target->radius};
  return {camera_center(scene.train_views), kExtentsOfBox * scene.extent};
}

// Uniform in their box; only points that some training camera sees.
std::vector<ScenePoint> random_points(const Scene& scene, const Config& config) {
  const Random random{config.train.seed, RandomStream::initialize};
  const auto [center, half] = random_box(scene, config);
  std::vector<ScenePoint> points;
  for (int i = 0; i < config.model.random_points; ++i) {
    const Vec4f u = random.uniform4(0, std::uint32_t(i));
    const Vec3f position = center + half * (2.0f * Vec3f(u.x, u.y, u.z) - Vec3f(1.0f));
    for (const View& view : scene.train_views)
      if (sees(view.camera, position, config.render.near_plane)) {
        points.push_back({position, {128, 128, 128}});
        break;
      }
  }
  return points;
}

struct Limit {
  std::int64_t count;
  const char* setting;
};

// The largest number of points that may become Gaussians.
Limit most_points(const Scene& scene, const Config& config) {
  Limit limit{kMostPoints, "the most points of a run"};
  if (scene.points.empty()) limit = {config.model.random_points, "model.random_points"};
  const std::int64_t cap = config.density.max_gaussians;
  if (cap > 0 && cap < limit.count) limit = {cap, "density.max_gaussians"};
  return limit;
}

std::vector<ScenePoint> starting_points(const Scene& scene, const Config& config) {
  const std::vector<ScenePoint> points =
      scene.points.empty() ? random_points(scene, config) : scene.points;
  if (points.empty())
    throw Error("there is nothing to start from in " + scene.source +
                ": the model has no points and no training camera sees a random one; check the "
                "reconstruction");
  const Limit limit = most_points(scene, config);
  std::vector<ScenePoint> kept = downsampled(points, std::size_t(limit.count));
  if (kept.size() < points.size())
    log_info("training starts from {} of {} points ({} = {})", kept.size(), points.size(),
             limit.setting, limit.count);
  return kept;
}

// A sphere of the point's color.
void set_row(const Gaussians& start, std::size_t row, const ScenePoint& point, float log_scale,
             float opacity) {
  start.mean[row] = point.position;
  start.log_scale[row] = Vec3f(log_scale);
  start.rotation[row] = {1, 0, 0, 0};
  start.logit_opacity[row] = logit(opacity);
  for (int c = 0; c < 3; ++c)
    start.sh0[row][c] = (float(point.color[c]) / 255.0f - kColorOffset) / float(kSh0);
  start.sh_rest[row] = {};
}

// Gaussians stand still, and their means in time are uniform in the scene's duration and a little
// beyond.   Yang et al. 2024
void spread_in_time(const Gaussians& start, const Config& config) {
  const Random random{config.train.seed, RandomStream::initial_time};
  parallel_for(start.count(), 4096, [&](std::size_t i) {
    start.right_rotation[i] = {1, 0, 0, 0};
    const float u = random.uniform4(0, std::uint32_t(i)).x;
    start.time_mean[i] = (1 + 2 * kInitialTimeMargin) * u - kInitialTimeMargin;
    start.log_time_scale[i] = std::log(config.model.initial_time_scale);
  });
}

}  // namespace

TrainingModel initial_model(const Scene& scene, const Config& config, Memory& memory) {
  const std::vector<ScenePoint> points = starting_points(scene, config);
  std::vector<Vec3f> means(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) means[i] = points[i].position;
  const KdTree tree({means.data(), means.size()});

  Gaussians start(host_memory());
  start.has_time = config.model.dynamic;
  start.resize(points.size());
  parallel_for(points.size(), 256, [&](std::size_t i) {
    const float distance2 =
        std::max(tree.mean_squared_distance(i, kInitialNeighbors), kMinNeighborDistance2);
    set_row(start, i, points[i], 0.5f * std::log(distance2) + std::log(config.model.initial_scale),
            config.model.initial_opacity);
  });
  if (start.has_time) spread_in_time(start, config);

  TrainingModel model(memory);
  model.store_moments_as(config.optimizer.moments);
  model.gaussians = copy_of(start, memory);
  clear_history(model);
  begin_photometric(config, scene, model);
  begin_poses(config, scene, model);
  return model;
}

}  // namespace gs
