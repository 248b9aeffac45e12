// SPDX-License-Identifier: Apache-2.0
// Stages, in order: plan every view from the model and the photos' headers (scene_plan.h), decode
// or leave that to a PhotoPool (make_views.h), split. README.md lists the files in this order.
#include "data_loaders/scene/load_scene.h"

#include <spdlog/fmt/fmt.h>

#include "data_loaders/counted.h"
#include "data_loaders/refine/refine_cameras.h"
#include "data_loaders/refine/refine_exposure.h"
#include "data_loaders/refine/tracks.h"
#include "data_loaders/scene/depth/depth_kind_of.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/make_views.h"
#include "data_loaders/scene/scene_model.h"
#include "data_loaders/scene/scene_plan.h"
#include "data_loaders/scene/view_picture.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

/// Logs the share of masked pixels in one line, and warns of a mode without masks.
void report_masks(const std::vector<View>& views, const DatasetConfig& dataset) {
  double share = 0;
  std::size_t masked = 0, over_background = 0;
  for (const View& view : views) {
    if (view.mask.empty()) continue;
    share += trained_share(view.mask);
    ++masked;
    over_background += view.over_background;
  }
  if (masked > 0)
    log_info("{} of {} photos are masked: {:.1f} % of their pixels {}", masked, views.size(),
             100 * share / double(masked),
             over_background ? "show the scene, the others its background" : "train");
  else if (dataset.mask_mode == MaskMode::background && !views.empty() && !views.front().source)
    log_warning("dataset.mask_mode is background, but no photo has a mask or alpha");
}

/// Splits the views and leaves out those without a pixel to train on.
void split_views(std::vector<View> views, const std::vector<bool>& is_test, Scene& scene) {
  std::vector<std::string> empty;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (views[i].has_untrained_pixels() && trained_share(views[i].mask) == 0)
      empty.push_back(views[i].name);
    else
      (is_test[i] ? scene.test_views : scene.train_views).push_back(std::move(views[i]));
  }
  if (empty.empty()) return;
  if (scene.train_views.empty())
    throw Error(fmt::format(
        "no photo of {} has a pixel to train on: the masks are black everywhere, and only white "
        "pixels are trained; invert them with --invert-masks, or leave them out with --masks none",
        scene.source));
  log_warning("{} masked everywhere and left out: {}{}",
              counted(empty.size(), "photo", "is", "are"), empty.front(),
              empty.size() > 1 ? ", ..." : "");
}

}  // namespace

std::string why_exposures_are_unknown(const DatasetConfig& dataset) {
  if (!can_refine()) return "this build has no Ceres, which solves for exposures";
  if (dataset.times == PhotoTimes::frames)
    return "the points were seen in one frame of each camera only";
  DatasetConfig solving = dataset;
  solving.exposure = true;  // so that the observations are read
  const SceneModel scene = read_scene_model(solving, find_scene(solving));
  return has_tracks(scene.model) ? "" : "the model does not say which photos show which points";
}

ExposureSummary measure_light(const DatasetConfig& dataset) {
  DatasetConfig solving = dataset;
  solving.exposure = true;
  solving.refine_cameras = false;
  solving.depth = "none";
  ScenePlan plan = plan_scene(solving, {});
  const std::vector<View> views =
      make_views(solving, std::move(plan.views), {}, PhotoLoading::when_asked);
  const ExposureFit fit = fit_view_exposures(plan.points, plan.seen, plan.is_test, views);
  return {fit.sample_count, fit.spread_before, fit.spread_after};
}

DepthAgreement measure_depth_maps(const DatasetConfig& dataset) {
  DatasetConfig looking = dataset;
  looking.refine_cameras = looking.exposure = false;
  const ScenePlan plan = plan_unsettled_scene(looking, {}, false);
  return depth_agreement(plan.views, plan.points);
}

void check_scene(const DatasetConfig& dataset) {
  DatasetConfig without_refinement = dataset;
  without_refinement.refine_cameras = false;
  plan_scene(without_refinement, {});
}

SceneOutline outline_scene(const DatasetConfig& dataset, const LoadProgress& progress) {
  ScenePlan plan = plan_scene(dataset, progress, true);
  if (!plan.is_used.empty()) leave_out_unused(plan);
  SceneOutline outline;
  for (const ViewPlan& view : plan.views) outline.names.push_back(view.name);
  outline.cameras = cameras_of(plan.views);
  outline.is_test = std::move(plan.is_test);
  outline.points = std::move(plan.points);
  outline.shown = std::move(plan.shown);
  outline.world_offset = plan.world_offset;
  return outline;
}

Scene load_scene(const DatasetConfig& dataset, const LoadProgress& progress, PhotoLoading loading,
                 const LightNeeds& needs) {
  ScenePlan plan = plan_scene(dataset, progress);
  std::optional<ExposureFit> fit;
  if (!plan.is_used.empty()) {
    // Of all photos, so that runs on parts of a scene agree about its colors
    if (dataset.exposure)
      fit = chosen_exposures(
          fit_view_exposures(plan.points, plan.seen, plan.is_test,
                             make_views(dataset, plan.views, {}, PhotoLoading::when_asked)),
          plan.is_used);
    leave_out_unused(plan);
  }
  if (needs.exposure_stops) read_exposure_stops(plan.views);
  Scene scene;
  scene.source = dataset.source;
  std::vector<View> views = make_views(dataset, std::move(plan.views), progress, loading);
  report_masks(views, dataset);
  if (dataset.exposure) {
    if (!fit) fit = fit_view_exposures(plan.points, plan.seen, plan.is_test, views);
    scene.exposure = take_exposures(*fit, views);
  }
  split_views(std::move(views), plan.is_test, scene);
  scene.points = std::move(plan.points);
  scene.world_offset = plan.world_offset;
  scene.time_count = plan.time_count;
  scene.refinement = plan.refinement;
  scene.extent = camera_extent(scene.train_views);
  for (const std::size_t outlier : outlier_cameras(scene.train_views))
    log_warning(
        "the camera of {} stands far away from all others; its pose may be wrong, and the scene's "
        "extent leaves it out",
        scene.train_views[outlier].name);
  return scene;
}

}  // namespace gs
