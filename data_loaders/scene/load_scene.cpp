// SPDX-License-Identifier: Apache-2.0
// Stages, in order: find the folders, read the model and find its files, plan every view from the
// photos' headers, decode (or leave that to a PhotoPool). README.md lists the files in this order.
#include "data_loaders/scene/load_scene.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <mutex>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/counted.h"
#include "data_loaders/photos/photo_pool.h"
#include "data_loaders/refine/refine_cameras.h"
#include "data_loaders/refine/refine_exposure.h"
#include "data_loaders/refine/solve_exposures.h"
#include "data_loaders/refine/tracks.h"
#include "data_loaders/scene/cached_picture.h"
#include "data_loaders/scene/depth_anchors.h"
#include "data_loaders/scene/depth_kind_of.h"
#include "data_loaders/scene/depth_map.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/photo_list.h"
#include "data_loaders/scene/plan_views.h"
#include "data_loaders/scene/scene_model.h"
#include "data_loaders/scene/view_picture.h"
#include "data_loaders/video/film_frames.h"
#include "gs_core/bytes.h"
#include "gs_core/error.h"
#include "gs_core/io/host_ram.h"
#include "gs_core/log.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr int kMostDecoders = 16;                               // threads of a PhotoPool
constexpr std::size_t kBytesForLooking = std::size_t(1) << 30;  // of photos, with when_asked

/// A scene before its photos are decoded.
struct ScenePlan {
  std::vector<ViewPlan> views;  // sorted by name
  std::vector<bool> is_test;    // (views)
  std::vector<ScenePoint> points;
  std::vector<std::vector<SeenPoint>> seen;  // (views)   empty without dataset.exposure
  std::vector<bool> is_used;                 // (views)   empty without dataset.photo_list
  ShownPoints shown;                         // (views)   empty unless asked for
  Vec3d world_offset{0.0, 0.0, 0.0};
  std::optional<CameraRefinement> refinement;
  std::size_t time_count = 0;
  DepthSource depth;
};

// --- Plan

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

std::vector<Camera> cameras_of(const std::vector<ViewPlan>& views) {
  std::vector<Camera> cameras;
  for (const ViewPlan& view : views) cameras.push_back(view.camera);
  return cameras;
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

/// The plan, with the depth maps as dataset.depth_kind says.
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
                     bool asks_who_shows = false) {
  ScenePlan plan = plan_unsettled_scene(dataset, progress, asks_who_shows);
  settle_depth(dataset, plan);
  return plan;
}

// --- Leave out

/// The elements that count, in order.
template <class T>
std::vector<T> chosen(std::vector<T> all, const std::vector<bool>& is_chosen) {
  std::vector<T> result;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (is_chosen[i]) result.push_back(std::move(all[i]));
  return result;
}

/// The fit of the photos that are used.
ExposureFit chosen_exposures(ExposureFit fit, const std::vector<bool>& is_used) {
  std::vector<std::size_t> unknown;
  for (const std::size_t i : fit.unknown)
    if (is_used[i])
      unknown.push_back(std::size_t(std::count(is_used.begin(), is_used.begin() + long(i), true)));
  fit.unknown = std::move(unknown);
  fit.exposures = chosen(std::move(fit.exposures), is_used);
  return fit;
}

/// Leaves out the views that are not used, and the points that no other view shows.
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

// --- Decode

/// A view without its picture.
View empty_view(const ViewPlan& plan) {
  View view;
  view.name = plan.name;
  view.camera = plan.camera;
  view.camera_id = plan.camera_id;
  view.rig_frame = plan.rig_frame;
  view.exposure_stops = plan.exposure_stops;
  view.may_be_masked = plan.may_be_masked;
  view.over_background = plan.masks.over_background && view.may_be_masked;
  view.has_depth_map = !plan.depth_file.empty();
  view.depth_kind = plan.depth_kind;
  return view;
}

View view_with(Picture picture, const ViewPlan& plan) {
  View view = empty_view(plan);
  view.photo = std::move(picture.photo);
  view.mask = std::move(picture.mask);
  view.over_background = plan.masks.over_background && !view.mask.empty();
  if (view.has_depth_map) {
    DepthMap map = make_depth_map(plan);
    view.depth = std::move(map.values);
    view.depth_kind = map.kind;
  }
  return view;
}

/// `cache` may be null.
View load_view(std::size_t index, const ViewPlan& plan, CachedPictures* cache) {
  return view_with(cache ? cache->picture(index, plan) : make_picture(plan), plan);
}

bool has_frames(const std::vector<ViewPlan>& plans) {
  return std::ranges::any_of(plans, [](const ViewPlan& plan) { return plan.is_frame; });
}

/// Makes the pictures of frames of videos within `budget` bytes, each video decoded once
/// (for_each_frame()).
void for_each_film_picture(const std::vector<ViewPlan>& plans, std::size_t budget,
                           const std::function<bool(std::size_t view)>& wants,
                           const std::function<void(std::size_t view, Picture picture)>& take) {
  std::vector<std::size_t> views;
  std::vector<VideoFrame> frames;
  std::size_t cost = 1;  // bytes of one frame in the making
  for (std::size_t i = 0; i < plans.size(); ++i) {
    if (!plans[i].is_frame) continue;
    views.push_back(i);
    frames.push_back({plans[i].file, plans[i].frame});
    cost = std::max(cost, plans[i].cost.decoding);
  }
  const std::size_t most_at_once = std::clamp<std::size_t>(budget / cost, 1, thread_count());
  for_each_frame(
      frames, most_at_once, [&](std::size_t k) { return wants(views[k]); },
      [&](std::size_t k, Image8 frame) {
        take(views[k], make_picture(plans[views[k]], {std::move(frame), {}}));
      });
}

/// All photos decoded.
std::vector<View> load_views(const std::vector<ViewPlan>& plans, CachedPictures* cache,
                             const LoadProgress& progress) {
  std::vector<View> views(plans.size());
  std::atomic<bool> has_failed = false;  // then the others need not be decoded
  std::mutex mutex;
  std::size_t done = 0;
  const auto count = [&] {
    const std::lock_guard lock(mutex);
    if (progress) progress(LoadStage::photos, ++done, plans.size());
  };
  parallel_for(plans.size(), 1, [&](std::size_t i) {
    if (has_failed) return;
    try {
      if (!plans[i].is_frame)
        views[i] = load_view(i, plans[i], cache);
      else if (auto kept = cache ? cache->find(i, plans[i]) : std::nullopt)
        views[i] = view_with(std::move(*kept), plans[i]);
      else
        return;  // decoded below, in the order of its video
    } catch (...) {
      has_failed = true;
      throw;
    }
    count();
  });
  for_each_film_picture(
      plans, std::numeric_limits<std::size_t>::max(),  // fit_into_ram() has counted all threads
      [&](std::size_t i) { return views[i].photo.empty(); },
      [&](std::size_t i, Picture picture) {
        if (cache) cache->store(i, plans[i], picture);
        views[i] = view_with(std::move(picture), plans[i]);
        count();
      });
  return views;
}

/// Puts the frames of videos into the cache, because a PhotoPool asks for them in any order. Warns
/// of those that it does not take. `cache` may be null.
void keep_frames(const std::vector<ViewPlan>& plans, CachedPictures* cache, std::size_t budget,
                 const LoadProgress& progress) {
  const auto frames =
      std::size_t(std::ranges::count_if(plans, [](const ViewPlan& plan) { return plan.is_frame; }));
  if (frames == 0) return;
  std::size_t kept = 0;
  if (cache) {
    std::mutex mutex;
    const auto count = [&] {
      const std::lock_guard lock(mutex);
      if (progress) progress(LoadStage::photos, ++kept, frames);
    };
    for_each_film_picture(
        plans, budget,
        [&](std::size_t i) {
          const bool is_kept = cache->has(i, plans[i]);
          if (is_kept) count();
          return !is_kept;
        },
        [&](std::size_t i, Picture picture) {
          cache->store(i, plans[i], picture);
          if (cache->has(i, plans[i])) count();
        });
  }
  if (kept < frames)
    log_warning(
        "{} of {} frames of videos fit neither into memory (--photo-ram) nor into the photo cache "
        "(dataset.photo_cache, dataset.photo_cache_gib): whenever one of them is needed, its video "
        "is decoded from the beginning, which is slow; give one of the two more, or train at a "
        "lower resolution (-r)",
        frames - kept, frames);
}

/// Whether all photos fit into memory at once while the last ones are still being decoded.
bool fit_into_ram(const std::vector<PhotoCost>& costs, std::size_t budget) {
  std::size_t held = 0, decoding = 0;
  for (const PhotoCost& cost : costs) {
    held += cost.held;
    decoding = std::max(decoding, cost.decoding);
  }
  return held + std::min<std::size_t>(std::size_t(thread_count()), costs.size()) * decoding <=
         budget;
}

/// Views without photos, and a pool that decodes them on demand.
std::vector<View> lazy_views(std::vector<ViewPlan> plans, std::vector<PhotoCost> costs,
                             std::size_t budget, std::shared_ptr<CachedPictures> cache) {
  std::vector<View> views;
  for (const ViewPlan& plan : plans) {
    views.push_back(empty_view(plan));
    views.back().index = views.size() - 1;
  }
  const auto shared_plans = std::make_shared<const std::vector<ViewPlan>>(std::move(plans));
  const auto pool = std::make_shared<PhotoPool>(
      std::move(costs),
      [shared_plans, cache](std::size_t i) {
        return load_view(i, (*shared_plans)[i], cache.get());
      },
      budget, std::clamp(thread_count() - 1, 1, kMostDecoders));
  for (View& view : views) view.source = pool;
  return views;
}

/// Views with their photos, or with a pool if they do not fit into memory.
std::vector<View> make_views(const DatasetConfig& dataset, std::vector<ViewPlan> plans,
                             const LoadProgress& progress, PhotoLoading loading) {
  std::vector<PhotoCost> costs;
  double held = 0;
  for (const ViewPlan& plan : plans) {
    costs.push_back(plan.cost);
    held += double(costs.back().held);
  }
  if (loading == PhotoLoading::when_asked) {
    const std::size_t budget = std::max(kBytesForLooking, PhotoPool::least_budget(costs));
    const std::shared_ptr<CachedPictures> kept =  // by training, perhaps
        has_frames(plans) ? cache_for(dataset, plans, false) : nullptr;
    return lazy_views(std::move(plans), std::move(costs), budget, kept);
  }
  std::size_t budget = photo_ram_bytes(dataset);
  const bool all_fit = fit_into_ram(costs, budget);
  const std::shared_ptr<CachedPictures> cache = cache_for(dataset, plans, all_fit);
  if (cache)
    log_info("photos that are ready for training are kept in {}", cache->folder().string());
  if (all_fit) return load_views(plans, cache.get(), progress);
  const std::size_t least = PhotoPool::least_budget(costs);
  if (dataset.photo_ram_gib > 0 && budget < least)
    throw UsageError(fmt::format(
        "dataset.photo_ram_gib is {}, but one of these photos in use while another one is decoded "
        "takes {:.3g}; give at least that (--photo-ram), or 0 for half of the machine's memory",
        dataset.photo_ram_gib, 1.01 * double(least) / kBytesPerGib));
  budget = std::max(budget, least);
  log_info(
      "the photos take {:.3g} GiB when decoded, but may take {:.3g} GiB of memory (--photo-ram): "
      "they are decoded just before their turn",
      held / kBytesPerGib, double(budget) / kBytesPerGib);
  keep_frames(plans, cache.get(), budget, progress);
  return lazy_views(std::move(plans), std::move(costs), budget, cache);
}

// --- Split

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
    return "its points were seen in one frame of each camera only";
  DatasetConfig solving = dataset;
  solving.exposure = true;  // so that the observations are read
  const SceneModel scene = read_scene_model(solving, find_scene(solving));
  return has_tracks(scene.model) ? "" : "its model does not say which photos show which points";
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
                             make_views(dataset, plan.views, {}, PhotoLoading::when_asked),
                             needs.vignetting),
          plan.is_used);
    leave_out_unused(plan);
  }
  if (needs.exposure_stops) read_exposure_stops(plan.views);
  Scene scene;
  scene.source = dataset.source;
  std::vector<View> views = make_views(dataset, std::move(plan.views), progress, loading);
  report_masks(views, dataset);
  if (dataset.exposure) {
    if (!fit)
      fit = fit_view_exposures(plan.points, plan.seen, plan.is_test, views, needs.vignetting);
    scene.exposure = take_exposures(*fit, views);
    scene.lenses = fit->lenses;
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
