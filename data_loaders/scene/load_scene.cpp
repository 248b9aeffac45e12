// SPDX-License-Identifier: Apache-2.0
// The stages of a scene: find -> read -> place -> plan -> decode. Each function at the end of this
// file stops after the stage that it needs. README.md lists the files in this order.
#include "data_loaders/scene/load_scene.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/counted.h"
#include "data_loaders/refine/refine_cameras.h"
#include "data_loaders/refine/solve_exposures.h"
#include "data_loaders/scene/companions.h"
#include "data_loaders/scene/decode_photos.h"
#include "data_loaders/scene/depth/depth_anchors.h"
#include "data_loaders/scene/depth/depth_kind_of.h"
#include "data_loaders/scene/normal_map.h"
#include "data_loaders/scene/photo_list.h"
#include "data_loaders/scene/place_scene.h"
#include "data_loaders/scene/plan_photos.h"
#include "data_loaders/scene/view_picture.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

/// Find, read and place. The images' observations are read `with_tracks`, and for photos' exposures,
/// dataset.photo_list and depth maps.
SceneModel placed_scene(const DatasetConfig& dataset, bool with_tracks) {
  if (dataset.exposure) check_can_refine("--exposure");
  const SceneFolders folders = find_scene(dataset);
  const bool has_depth = !find_companions(kDepthMaps, dataset).folder.empty();
  with_tracks |= has_depth || dataset.exposure || !dataset.photo_list.empty();
  SceneModel scene = read_scene(dataset, folders, with_tracks ? Tracks::read : Tracks::skip);
  place_scene(dataset, scene);
  if (scene.world_offset != Vec3d(0.0))
    log_info(
        "the scene lies far from the origin: {} is subtracted from its coordinates, because single "
        "precision cannot hold them",
        text_of_offset(scene.world_offset));
  return scene;
}

std::function<void(std::size_t, std::size_t)> progress_of(LoadStage stage,
                                                          const LoadProgress& progress) {
  return [&progress, stage](std::size_t done, std::size_t total) {
    if (progress) progress(stage, done, total);
  };
}

/// placed_scene() with dataset.refine_cameras.
SceneModel refined_scene(const DatasetConfig& dataset, const LoadProgress& progress,
                         bool with_tracks) {
  if (!dataset.refine_cameras) return placed_scene(dataset, with_tracks);
  check_can_refine("--refine-cameras");
  SceneModel scene = placed_scene(dataset, true);
  scene.refinement = refine_cameras(scene.model, progress_of(LoadStage::refinement, progress));
  const CameraRefinement& refinement = *scene.refinement;
  log_info(
      "cameras refined in {} steps, {:.1f} s: {} observations of {} points in {} photos; mean "
      "error {:.3f} pixels, {:.3f} before (median {:.3f}, {:.3f} before){}",
      refinement.steps, refinement.seconds, refinement.observations, refinement.points,
      refinement.images, refinement.mean_error_after, refinement.mean_error_before,
      refinement.median_error_after, refinement.median_error_before,
      refinement.has_converged ? "" : "; stopped at the largest number of steps");
  return scene;
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

/// Marks the photos of dataset.photo_list.
void choose_listed_photos(const DatasetConfig& dataset, std::vector<Photo>& photos) {
  std::vector<std::string> names;
  for (const Photo& photo : photos) names.push_back(photo.name);
  const std::vector<bool> is_used = photos_in_list(dataset.photo_list, names);
  for (std::size_t i = 0; i < photos.size(); ++i) photos[i].is_used = is_used[i];
  if (std::ranges::none_of(photos, [](const Photo& p) { return p.is_used && !p.is_test; }))
    throw UsageError(
        fmt::format("no view is left to train on: dataset.eval holds out all photos that "
                    "dataset.photo_list {} names; name more, or train without dataset.eval",
                    dataset.photo_list));
}

void find_seen_points(SceneModel& scene) {
  auto seen = seen_points(scene.model, "--exposure");
  for (std::size_t i = 0; i < seen.size(); ++i) scene.photos[i].seen = std::move(seen[i]);
}

/// The plan: all that is known before photos are decoded, but for the kind of depth maps.
void plan_scene(const DatasetConfig& dataset, SceneModel& scene, const LoadProgress& progress) {
  if (dataset.exposure) find_seen_points(scene);
  plan_photos(scene, dataset.lens, dataset.resolution, progress_of(LoadStage::headers, progress));
  add_depth_anchors(scene.model, scene.photos);
  scene.points = single_precision_points(scene.model);
  if (dataset.photo_list.empty()) return;
  choose_listed_photos(dataset, scene.photos);
  find_shown_points(scene);
}

/// Finds out what the depth maps hold, where dataset.depth_kind is auto, and says it. Maps that go
/// with nothing are refused if dataset.depth names them, and else left out.
void settle_depth(const DatasetConfig& dataset, SceneModel& scene) {
  const auto has_map = [](const Photo& photo) { return !photo.depth_file.empty(); };
  const auto count = std::size_t(std::ranges::count_if(scene.photos, has_map));
  if (count == 0) return;
  DepthKind kind = dataset.depth_kind;
  if (kind == DepthKind::automatic) kind = depth_agreement(scene.photos, scene.points).kind();
  if (kind == DepthKind::automatic) {
    const std::string why = fmt::format(
        "the sparse points do not tell what the depth maps in {} hold; say it with --set "
        "dataset.depth_kind=metric (or scaled, relative, inverse)",
        scene.depth.place());
    if (scene.depth.is_named)
      throw Error(why + ", or train without them (--set dataset.depth=none)");
    log_warning("{}; they are left out", why);
  } else {
    const auto anchored = std::ranges::count_if(scene.photos, is_anchored);
    log_info("{} of {} have a depth map in {}: {}{}{}", count,
             counted(scene.photos.size(), "photo"), scene.depth.place(), text_of(kind),
             dataset.depth_kind == DepthKind::automatic ? ", as the sparse points tell" : "",
             kind == DepthKind::metric
                 ? ""
                 : fmt::format("; the points that it shows bring {} to world units",
                               counted(std::size_t(anchored), "map")));
  }
  for (Photo& photo : scene.photos) {
    photo.depth_kind = kind;
    if (kind == DepthKind::automatic && has_map(photo)) leave_out_depth(photo);
  }
}

/// Finds the normal maps, and says how many there are.
void find_normal_maps(const DatasetConfig& dataset, SceneModel& scene) {
  match_companions(kNormalMaps, dataset, scene);
  for (Photo& photo : scene.photos) photo.normal_axes = dataset.normal_axes;
  const auto count = std::ranges::count_if(
      scene.photos, [](const Photo& photo) { return !photo.normal_file.empty(); });
  if (count > 0)
    log_info("{} of {} have a normal map in {}", count, counted(scene.photos.size(), "photo"),
             scene.normals.place());
}

/// The plan, with the maps that are needed.
void plan_with_maps(const DatasetConfig& dataset, const SceneNeeds& needs, SceneModel& scene,
                    const LoadProgress& progress) {
  if (needs.normal_maps) find_normal_maps(dataset, scene);
  plan_scene(dataset, scene, progress);
  settle_depth(dataset, scene);
  if (needs.normal_maps) check_normal_axes(scene.photos, scene.normals.place());
}

std::vector<bool> flags_of(const std::vector<Photo>& photos, bool Photo::*flag) {
  std::vector<bool> flags;
  for (const Photo& photo : photos) flags.push_back(photo.*flag);
  return flags;
}

std::vector<std::vector<SeenPoint>> take_seen(std::vector<Photo>& photos) {
  std::vector<std::vector<SeenPoint>> seen;
  for (Photo& photo : photos) seen.push_back(std::move(photo.seen));
  return seen;
}

/// The exposures of the photos that are used; `fit` has those of all.
ExposureFit chosen_exposures(ExposureFit fit, const std::vector<bool>& is_used) {
  std::erase_if(fit.unknown, [&](std::size_t i) { return !is_used[i]; });
  for (std::size_t& i : fit.unknown)
    i = std::size_t(std::count(is_used.begin(), is_used.begin() + long(i), true));
  keep(is_used, fit.exposures);
  return fit;
}

/// Leaves out the photos that are not used, and the points that no other photo shows.
void leave_out_unused(SceneModel& scene) {
  const std::size_t photos = scene.photos.size(), points = scene.points.size();
  std::erase_if(scene.photos, [](const Photo& photo) { return !photo.is_used; });
  std::vector<bool> is_shown(points, false);
  for (const Photo& photo : scene.photos)
    for (const std::uint32_t point : photo.shown) is_shown[point] = true;
  std::vector<std::uint32_t> numbers(points);  // of the points that stay
  for (std::uint32_t i = 0, next = 0; i < points; ++i) numbers[i] = is_shown[i] ? next++ : 0;
  keep(is_shown, scene.points);
  for (Photo& photo : scene.photos)
    for (std::uint32_t& point : photo.shown) point = numbers[point];
  log_info("dataset.photo_list: {} of {} photos, and {} of {} points, which they show",
           scene.photos.size(), photos, scene.points.size(), points);
}

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
  const SceneModel scene = read_scene(dataset, find_scene(dataset), Tracks::read);
  return has_tracks(scene.model) ? "" : "the model does not say which photos show which points";
}

ExposureSummary measure_light(const DatasetConfig& dataset) {
  SceneModel scene = placed_scene(dataset, true);
  for (Photo& photo : scene.photos) photo.depth_file.clear();
  if (!dataset.exposure) find_seen_points(scene);
  plan_scene(dataset, scene, {});
  const auto seen = take_seen(scene.photos);
  const auto is_test = flags_of(scene.photos, &Photo::is_test);
  const std::vector<View> views =
      decode_photos(dataset, std::move(scene.photos), {}, PhotoLoading::when_asked);
  const ExposureFit fit = fit_view_exposures(scene.points, seen, is_test, views);
  return {fit.sample_count, fit.spread_before, fit.spread_after};
}

DepthAgreement measure_depth_maps(const DatasetConfig& dataset) {
  SceneModel scene = placed_scene(dataset, false);
  plan_scene(dataset, scene, {});
  return depth_agreement(scene.photos, scene.points);
}

void check_scene(const DatasetConfig& dataset, const SceneNeeds& needs) {
  SceneModel scene = placed_scene(dataset, false);
  plan_with_maps(dataset, needs, scene, {});
}

SceneOutline outline_scene(const DatasetConfig& dataset, const LoadProgress& progress) {
  SceneModel scene = refined_scene(dataset, progress, true);
  plan_scene(dataset, scene, progress);
  if (dataset.photo_list.empty()) find_shown_points(scene);
  settle_depth(dataset, scene);
  if (!dataset.photo_list.empty()) leave_out_unused(scene);
  SceneOutline outline;
  for (Photo& photo : scene.photos) {
    outline.names.push_back(photo.name);
    outline.cameras.push_back(photo.camera);
    outline.is_test.push_back(photo.is_test);
    outline.shown.push_back(std::move(photo.shown));
  }
  outline.points = std::move(scene.points);
  outline.world_offset = scene.world_offset;
  return outline;
}

Scene load_scene(const DatasetConfig& dataset, const LoadProgress& progress, PhotoLoading loading,
                 const SceneNeeds& needs) {
  SceneModel model = refined_scene(dataset, progress, false);
  plan_with_maps(dataset, needs, model, progress);
  model.model = {};  // its memory is needed
  const auto seen = take_seen(model.photos);
  std::vector<bool> is_test = flags_of(model.photos, &Photo::is_test);
  const auto fit_to = [&](const std::vector<View>& views) {
    return fit_view_exposures(model.points, seen, is_test, views);
  };
  std::optional<ExposureFit> fit;
  if (!dataset.photo_list.empty()) {
    // Of all photos, so that runs on parts of a scene agree about its colors
    if (dataset.exposure)
      fit = chosen_exposures(
          fit_to(decode_photos(dataset, model.photos, {}, PhotoLoading::when_asked)),
          flags_of(model.photos, &Photo::is_used));
    leave_out_unused(model);
    is_test = flags_of(model.photos, &Photo::is_test);
  }
  if (needs.exposure_stops) read_exposure_stops(model.photos);
  Scene scene;
  scene.source = dataset.source;
  std::vector<View> views = decode_photos(dataset, std::move(model.photos), progress, loading);
  report_masks(views, dataset);
  if (dataset.exposure) {
    if (!fit) fit = fit_to(views);
    scene.exposure = take_exposures(*fit, views);
  }
  split_views(std::move(views), is_test, scene);
  scene.points = std::move(model.points);
  scene.world_offset = model.world_offset;
  scene.time_count = model.time_count;
  scene.refinement = model.refinement;
  scene.extent = camera_extent(scene.train_views);
  for (const std::size_t outlier : outlier_cameras(scene.train_views))
    log_warning(
        "the camera of {} stands far away from all others; its pose may be wrong, and the scene's "
        "extent leaves it out",
        scene.train_views[outlier].name);
  return scene;
}

}  // namespace gs
