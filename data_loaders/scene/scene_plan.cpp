// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/scene_plan.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/counted.h"
#include "data_loaders/refine/refine_cameras.h"
#include "data_loaders/refine/refine_exposure.h"
#include "data_loaders/refine/tracks.h"
#include "data_loaders/scene/depth/depth_anchors.h"
#include "data_loaders/scene/depth/depth_kind_of.h"
#include "data_loaders/scene/depth/depth_map.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/photo_list.h"
#include "data_loaders/scene/scene_model.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

void log_refinement(const CameraRefinement& refinement) {
  log_info(
      "cameras refined in {} steps, {:.1f} s: {} observations of {} points in {} photos; mean "
      "error {:.3f} pixels, {:.3f} before (median {:.3f}, {:.3f} before){}",
      refinement.steps, refinement.seconds, refinement.observations, refinement.points,
      refinement.images, refinement.mean_error_after, refinement.mean_error_before,
      refinement.median_error_after, refinement.median_error_before,
      refinement.has_converged ? "" : "; stopped at the largest number of steps");
}

std::vector<ScenePoint> single_precision_points(const ColmapModel& model) {
  std::vector<ScenePoint> points;
  points.reserve(model.points.size());
  for (const ColmapPoint& point : model.points) {
    points.push_back({Vec3f(point.position), point.color});
    if (!is_finite(points.back().position))
      throw Error(
          fmt::format("point {} of the model in {} does not fit single precision; remove it "
                      "with `colmap point_filtering`",
                      point.id, model.folder.string()));
  }
  return points;
}

void choose_listed_photos(const DatasetConfig& dataset, ScenePlan& plan) {
  std::vector<std::string> names;
  for (const ViewPlan& view : plan.views) names.push_back(view.name);
  plan.is_used = photos_in_list(dataset.photo_list, names);
  for (std::size_t i = 0; i < names.size(); ++i)
    if (plan.is_used[i] && !plan.is_test[i]) return;
  throw UsageError(
      fmt::format("no view is left to train on: dataset.eval holds out all photos that "
                  "dataset.photo_list {} names; name more, or train without dataset.eval",
                  dataset.photo_list));
}

/// Finds out what the depth maps hold, where dataset.depth_kind is auto, and says it. Maps that go
/// with nothing are refused if dataset.depth names them, and else left out.
void settle_depth(const DatasetConfig& dataset, ScenePlan& plan) {
  const DepthSource& source = plan.depth;
  const auto has_map = [](const ViewPlan& view) { return !view.depth_file.empty(); };
  const auto count = std::size_t(std::ranges::count_if(plan.views, has_map));
  if (count == 0) return;
  DepthKind kind = source.kind;
  if (kind == DepthKind::automatic) kind = depth_agreement(plan.views, plan.points).kind();
  const std::string place =
      source.folder.empty() ? "the files that the model names" : source.folder.string();
  if (kind == DepthKind::automatic) {
    const std::string why = fmt::format(
        "the sparse points do not tell what the depth maps in {} hold; say it with --set "
        "dataset.depth_kind=metric (or scaled, relative, inverse)",
        place);
    if (source.is_named) throw Error(why + ", or train without them (--set dataset.depth=none)");
    log_warning("{}; they are left out", why);
  } else {
    const auto anchored = std::ranges::count_if(plan.views, is_anchored);
    log_info("{} of {} have a depth map in {}: {}{}{}", count, counted(plan.views.size(), "photo"),
             place, text_of(kind),
             dataset.depth_kind == DepthKind::automatic ? ", as the sparse points tell" : "",
             kind == DepthKind::metric
                 ? ""
                 : fmt::format("; the points that it shows bring {} to world units",
                               counted(std::size_t(anchored), "map")));
  }
  for (ViewPlan& view : plan.views) {
    view.depth_kind = kind;
    if (kind == DepthKind::automatic && has_map(view)) leave_out_depth(view);
  }
}

/// The elements that count, in order.
template <class T>
std::vector<T> chosen(std::vector<T> all, const std::vector<bool>& is_chosen) {
  std::vector<T> result;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (is_chosen[i]) result.push_back(std::move(all[i]));
  return result;
}

}  // namespace

std::vector<Camera> cameras_of(const std::vector<ViewPlan>& views) {
  std::vector<Camera> cameras;
  for (const ViewPlan& view : views) cameras.push_back(view.camera);
  return cameras;
}

ScenePlan plan_unsettled_scene(const DatasetConfig& dataset, const LoadProgress& progress,
                               bool asks_who_shows) {
  const auto progress_of = [&](LoadStage stage) {
    return [&progress, stage](std::size_t done, std::size_t total) {
      if (progress) progress(stage, done, total);
    };
  };
  if (dataset.exposure) check_can_refine("--exposure");
  if (dataset.refine_cameras) check_can_refine("--refine-cameras");
  asks_who_shows |= !dataset.photo_list.empty();
  SceneModel scene =
      read_scene_model(dataset, find_scene(dataset), asks_who_shows ? Tracks::read : Tracks::skip);
  ScenePlan plan;
  plan.time_count = scene.time_count;
  plan.world_offset = scene.world_offset;
  if (plan.world_offset != Vec3d(0.0))
    log_info(
        "the scene lies far from the origin: {} is subtracted from its coordinates, because single "
        "precision cannot hold them",
        text_of_offset(plan.world_offset));
  if (dataset.refine_cameras) {
    plan.refinement = refine_cameras(scene.model, progress_of(LoadStage::refinement));
    log_refinement(*plan.refinement);
  }
  if (dataset.exposure) plan.seen = seen_points(scene.model, "--exposure");
  plan.views = plan_views(scene, dataset.resolution, progress_of(LoadStage::headers));
  add_depth_anchors(scene.model, plan.views);
  plan.points = single_precision_points(scene.model);
  plan.depth = std::move(scene.depth);
  plan.is_test = std::move(scene.is_test);
  if (!dataset.photo_list.empty()) choose_listed_photos(dataset, plan);
  if (asks_who_shows) plan.shown = shown_points(scene.model, cameras_of(plan.views), plan.points);
  return plan;
}

ScenePlan plan_scene(const DatasetConfig& dataset, const LoadProgress& progress,
                     bool asks_who_shows) {
  ScenePlan plan = plan_unsettled_scene(dataset, progress, asks_who_shows);
  settle_depth(dataset, plan);
  return plan;
}

ExposureFit chosen_exposures(ExposureFit fit, const std::vector<bool>& is_used) {
  std::vector<std::size_t> unknown;
  for (const std::size_t i : fit.unknown)
    if (is_used[i])
      unknown.push_back(std::size_t(std::count(is_used.begin(), is_used.begin() + long(i), true)));
  fit.unknown = std::move(unknown);
  fit.exposures = chosen(std::move(fit.exposures), is_used);
  return fit;
}

void leave_out_unused(ScenePlan& plan) {
  const std::size_t views = plan.views.size(), points = plan.points.size();
  const std::vector<bool> is_shown = points_shown_by(plan.shown, plan.is_used, points);
  std::vector<std::uint32_t> numbers(points);  // of the points that stay
  for (std::uint32_t i = 0, next = 0; i < points; ++i) numbers[i] = is_shown[i] ? next++ : 0;
  plan.points = chosen(std::move(plan.points), is_shown);
  plan.views = chosen(std::move(plan.views), plan.is_used);
  plan.is_test = chosen(std::move(plan.is_test), plan.is_used);
  plan.shown = chosen(std::move(plan.shown), plan.is_used);
  for (std::vector<std::uint32_t>& shown : plan.shown)
    for (std::uint32_t& point : shown) point = numbers[point];
  plan.seen.clear();
  log_info("dataset.photo_list: {} of {} photos, and {} of {} points, which they show",
           plan.views.size(), views, plan.points.size(), points);
}

}  // namespace gs
