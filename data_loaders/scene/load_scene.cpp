// SPDX-License-Identifier: Apache-2.0
// Stages, in order: find, read the model, split, plan every view from the photos' headers, decode (or leave that to a
// PhotoPool).
#include "data_loaders/scene/load_scene.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <tuple>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/lenses/undistort.h"
#include "data_loaders/photos/photo_fit.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/photos/photo_pool.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/refine/refine_cameras.h"
#include "data_loaders/refine/refine_exposure.h"
#include "data_loaders/refine/tracks.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/scene_model.h"
#include "data_loaders/scene/view_picture.h"
#include "gs_core/bytes.h"
#include "gs_core/error.h"
#include "gs_core/io/host_ram.h"
#include "gs_core/log.h"
#include "gs_core/math/rotation.h"
#include "gs_core/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr int kMostDecoders = 16;  // threads of a PhotoPool
constexpr std::size_t kRoomForLooking = std::size_t(1) << 30;  // bytes of photos kept for those who look at some
// Smaller photos are not kept in a cache that nobody named: they are decoded in 10 ms.
constexpr std::int64_t kWorthCaching = std::int64_t(1) << 20;  // pixels
/// In all photos together: the rest would tell nothing new of three numbers per photo.
constexpr std::size_t kMostColorSamples = 1000000;

/// Names lead to files below the images folder, here and wherever a run writes pictures by view
/// name.
void check_name(const ColmapImage& image, const fs::path& model) {
  const fs::path name = image.name;
  if (name.is_absolute() || std::find(name.begin(), name.end(), "..") != name.end())
    throw Error(
        fmt::format("cannot use the model in {}: image name '{}' leads out of the images folder; "
                    "rename it in the "
                    "model",
                    model.string(), image.name));
}

/// Refuses a model with next to nothing of the photos: COLMAP gave up, or began anew elsewhere.
void check_registered(const ColmapModel& model, const fs::path& images) {
  constexpr std::size_t kFewRegistered = 3;  // fewer are suspicious
  constexpr std::size_t kManyTimes = 3;      // as many photos or more are "many more"
  const std::size_t registered = model.images.size();
  if (registered >= kFewRegistered) return;
  const std::size_t photos = picture_names_in(images).size();
  if (photos < kManyTimes * registered) return;
  throw Error(fmt::format(
      "the model in {} holds only {} of the {} photos in {}: COLMAP could not register the others; "
      "run COLMAP again (exhaustive matching, or photos that overlap more), or take this model all "
      "the same by naming it with --set dataset.model=FOLDER",
      model.folder.string(), registered, photos, images.string()));
}

/// The camera of the model at the size that its photo really has.
LensCamera fitted_to_photo(LensCamera lens, const ViewPlan& plan) {
  const PhotoSize model = {lens.pinhole.width, lens.pinhole.height}, photo = plan.photo_size;
  const PhotoFit fit = fit_of(photo, model);
  if (fit == PhotoFit::fits) {
    lens.pinhole = resized(lens.pinhole, photo.width, photo.height);
    return lens;
  }
  const std::string sizes =
      fmt::format("photo {} has {} x {} pixels and its camera in the model {} x {}",
                  plan.file.string(), photo.width, photo.height, model.width, model.height);
  if (fit == PhotoFit::turned)
    throw Error(
        sizes +
        ": width and height are swapped, so one of the two was turned by the photo's EXIF "
        "orientation; turn the pixels themselves (`mogrify -auto-orient` on copies of the photos) "
        "and give COLMAP and gemsplat these same files");
  throw Error(
      sizes +
      ": the shapes differ, so this is not the photo that COLMAP saw; use the same photos, or run "
      "COLMAP again on these");
}

/// Refuses a dataset.resolution that is none of 1, 2, 4, 8, or is wider than the photo.
void check_resolution(int resolution, const PinholeCamera<double>& camera,
                      const std::string& name) {
  const bool divides = resolution == 1 || resolution == 2 || resolution == 4 || resolution == 8;
  if (!divides && resolution <= 8)
    throw UsageError(fmt::format(
        "dataset.resolution is {}; give 1, 2, 4 or 8 to divide the photos' size, or a width "
        "of at least 16 pixels",
        resolution));
  if (!divides && resolution > camera.width)
    throw UsageError(fmt::format(
        "dataset.resolution asks for {} pixels of width and photo '{}' has {}; give at most {}, "
        "or 1 for the photos' own size",
        resolution, name, camera.width, camera.width));
}

std::vector<ViewPlan> plan_views(const DatasetConfig& dataset, const ColmapModel& model,
                                 const fs::path& images, const MaskSource& masks,
                                 const LoadProgress& progress) {
  std::vector<std::string> names;
  std::vector<fs::path> masks_of_model;
  for (const ColmapImage& image : model.images) {
    check_name(image, model.folder);
    names.push_back(image.name);
    masks_of_model.push_back(image.mask);
  }
  const std::vector<fs::path> files = find_photos(names, images);
  const std::vector<fs::path> mask_files = match_masks(masks, names, files, masks_of_model);
  std::vector<ViewPlan> plans;
  for (std::size_t i = 0; i < names.size(); ++i)
    plans.push_back({model.images[i], files[i], mask_files[i], {}, {}, {}, {}, {}});
  constexpr std::size_t kHeadersPerChunk = 8;
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(plans.size(), kHeadersPerChunk, [&](std::size_t i) {
    plans[i].photo_size = read_photo_size(plans[i].file);
    if (!mask_files[i].empty()) check_mask_size(mask_files[i], plans[i].file, plans[i].photo_size);
    const std::lock_guard lock(mutex);
    if (progress) progress(LoadStage::headers, ++done, plans.size());
  });

  std::size_t scaled = 0;
  std::map<std::tuple<std::uint32_t, int, int>, PinholeCamera<double>> undistorted;  // one search per camera
  for (ViewPlan& plan : plans) {
    const ColmapCamera& camera = model.cameras.at(plan.image.camera_id);
    plan.lens = fitted_to_photo(lens_camera(camera, plan.image.name), plan);
    const auto [width, height] = plan.photo_size;
    if (width != camera.width || height != camera.height) ++scaled;
    const auto [found, is_new] = undistorted.try_emplace({camera.id, width, height});
    if (is_new) found->second = undistorted_pinhole(plan.lens, plan.image.name);
    plan.undistorted = found->second;
    check_resolution(dataset.resolution, plan.undistorted, plan.image.name);
    plan.target = at_resolution(plan.undistorted, dataset.resolution);
  }
  if (scaled)
    log_info(
        "{} of {} photos differ in size from their cameras in the model: intrinsics scaled to the "
        "photos",
        scaled, plans.size());
  return plans;
}

Camera single_precision_camera(const ViewPlan& plan) {
  PinholeCamera<double> posed = plan.target;
  posed.cam_from_world_rotation = rotation_matrix(plan.image.cam_from_world_rotation);
  posed.cam_from_world_translation = plan.image.cam_from_world_translation;
  const Camera camera = camera_as<float>(posed);
  if (!is_finite(camera.position()) || !is_finite(Vec3f(camera.fx, camera.cx, 0)) ||
      !is_finite(Vec3f(camera.fy, camera.cy, 0)))
    throw Error(fmt::format(
        "the camera of photo '{}' does not fit single precision; leave the photo out of the model, "
        "or move the model nearer to its origin with `colmap model_aligner`",
        plan.image.name));
  return camera;
}

/// All but the picture.
View empty_view(const ViewPlan& plan, const MaskSource& masks) {
  View view;
  view.name = plan.image.name;
  view.camera = single_precision_camera(plan);
  view.may_be_masked = may_be_masked(plan, masks);
  view.over_background = masks.over_background && view.may_be_masked;
  return view;
}

/// `cache` may be null.
View load_view(ViewPlan& plan, const MaskSource& masks, PhotoCache* cache) {
  View view = empty_view(plan, masks);
  Picture picture = cache ? cached_picture(plan, masks, *cache) : make_picture(plan, masks);
  view.photo = std::move(picture.photo);
  view.mask = std::move(picture.mask);
  view.over_background = masks.over_background && !view.mask.empty();
  return view;
}

std::vector<View> load_views(std::vector<ViewPlan>& plans, const MaskSource& masks,
                             PhotoCache* cache, const LoadProgress& progress) {
  std::vector<View> views(plans.size());
  std::atomic<bool> has_failed = false;  // then the others need not be decoded
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(plans.size(), 1, [&](std::size_t i) {
    if (has_failed) return;
    try {
      views[i] = load_view(plans[i], masks, cache);
    } catch (...) {
      has_failed = true;
      throw;
    }
    const std::lock_guard lock(mutex);
    if (progress) progress(LoadStage::photos, ++done, plans.size());
  });
  return views;
}

/// Whether all photos can be in memory at once, the last ones being decoded.
bool fit_into_ram(const std::vector<PhotoCost>& costs, std::size_t budget) {
  std::size_t held = 0, decoding = 0;
  for (const PhotoCost& cost : costs) {
    held += cost.held;
    decoding = std::max(decoding, cost.decoding);
  }
  return held + std::min<std::size_t>(std::size_t(thread_count()), costs.size()) * decoding <=
         budget;
}

/// The cache, where it saves work: photos are read again and again, or more than decoded.
std::shared_ptr<PhotoCache> cache_for(const DatasetConfig& dataset,
                                      const std::vector<ViewPlan>& plans, bool all_fit) {
  const bool is_named = dataset.photo_cache != "auto";
  if (dataset.photo_cache == "none" || dataset.photo_cache_gib <= 0) return nullptr;
  const bool helps = std::any_of(plans.begin(), plans.end(), [&](const ViewPlan& plan) {
    const std::int64_t pixels = std::int64_t(plan.photo_size.width) * plan.photo_size.height;
    return (!all_fit || plan.has_lens() || plan.is_resized()) &&
           (is_named || pixels >= kWorthCaching);
  });
  if (!helps) return nullptr;
  if (!can_cache_photos()) {
    if (is_named) log_warning("dataset.photo_cache is not used: this build has no zstd and xxhash");
    return nullptr;
  }
  const fs::path folder = is_named ? fs::path(dataset.photo_cache) : usual_photo_cache();
  if (folder.empty()) return nullptr;
  return std::make_shared<PhotoCache>(
      folder, std::uint64_t(double(dataset.photo_cache_gib) * kBytesPerGib));
}

/// Views without photos, and a pool that brings them.
std::vector<View> lazy_views(std::vector<ViewPlan> plans, const MaskSource& masks,
                             std::vector<PhotoCost> costs, std::size_t budget,
                             std::shared_ptr<PhotoCache> cache) {
  std::vector<View> views;
  for (const ViewPlan& plan : plans) {
    views.push_back(empty_view(plan, masks));
    views.back().index = views.size() - 1;
  }
  const auto shared_plans = std::make_shared<std::vector<ViewPlan>>(std::move(plans));
  const auto pool = std::make_shared<PhotoPool>(
      std::move(costs),
      [shared_plans, masks, cache](std::size_t i) {
        return load_view((*shared_plans)[i], masks, cache.get());
      },
      budget, std::clamp(thread_count() - 1, 1, kMostDecoders));
  for (View& view : views) view.source = pool;
  return views;
}

/// All photos decoded, or none yet.
std::vector<View> make_views(const DatasetConfig& dataset, std::vector<ViewPlan> plans,
                             const MaskSource& masks, const LoadProgress& progress,
                             PhotoLoading loading) {
  std::vector<PhotoCost> costs;
  double held = 0;
  for (const ViewPlan& plan : plans) {
    costs.push_back(cost_of(plan, masks));
    held += double(costs.back().held);
  }
  if (loading == PhotoLoading::when_asked) {
    const std::size_t room = std::max(kRoomForLooking, PhotoPool::least_budget(costs));
    return lazy_views(std::move(plans), masks, std::move(costs), room, nullptr);
  }
  std::size_t budget = photo_ram_bytes(dataset);
  const bool all_fit = fit_into_ram(costs, budget);
  const std::shared_ptr<PhotoCache> cache = cache_for(dataset, plans, all_fit);
  if (cache) log_info("photos ready for training are kept in {}", cache->folder().string());
  if (all_fit) return load_views(plans, masks, cache.get(), progress);
  const std::size_t least = PhotoPool::least_budget(costs);
  if (dataset.photo_ram_gib > 0 && budget < least)
    throw UsageError(fmt::format(
        "dataset.photo_ram_gib is {}, and one of these photos in use while another one is decoded "
        "takes {:.3g}; give at least that (--photo-ram), or 0 for half of the machine's memory",
        dataset.photo_ram_gib, 1.01 * double(least) / kBytesPerGib));
  budget = std::max(budget, least);
  log_info(
      "the photos take {:.3g} GiB when decoded, and {:.3g} GiB of memory are theirs (--photo-ram): "
      "they are decoded when it is their turn",
      held / kBytesPerGib, double(budget) / kBytesPerGib);
  return lazy_views(std::move(plans), masks, std::move(costs), budget, cache);
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

/// A scene before its photos are decoded.
struct ScenePlan {
  MaskSource masks;
  std::vector<ViewPlan> views;  // sorted by name
  std::vector<bool> is_test;
  std::vector<ScenePoint> points;
  std::vector<std::vector<SeenPoint>> seen;  // (views): where asked for
  Vec3d world_offset{0.0, 0.0, 0.0};
  std::optional<CameraRefinement> refinement;
};

void log_exposures(const ExposureFit& fit) {
  float lowest = 1, highest = 1;
  for (const Vec3f& exposure : fit.exposures) {
    lowest = std::min({lowest, exposure.x, exposure.y, exposure.z});
    highest = std::max({highest, exposure.x, exposure.y, exposure.z});
  }
  log_info(
      "exposures from {} colors of shared points: {:.2f} to {:.2f}; a point's colors differ by "
      "{:.1f} % between photos "
      "without them, by {:.1f} % with them",
      fit.sample_count, lowest, highest, 100 * fit.spread_before, 100 * fit.spread_after);
}

void log_refinement(const CameraRefinement& refinement) {
  log_info(
      "cameras refined in {} steps, {:.1f} s: {} observations of {} points in {} photos are off by "
      "{:.3f} pixels in the "
      "mean, {:.3f} before (median {:.3f}, {:.3f} before){}",
      refinement.steps, refinement.seconds, refinement.observations, refinement.points,
      refinement.images, refinement.mean_error_after, refinement.mean_error_before,
      refinement.median_error_after, refinement.median_error_before,
      refinement.has_converged ? "" : "; stopped at the cap of steps");
}

ScenePlan plan_scene(const DatasetConfig& dataset, const LoadProgress& progress) {
  if (dataset.exposure) check_can_refine("--exposure");
  if (dataset.refine_cameras) check_can_refine("--refine-cameras");
  const SceneFolders folders = find_scene(dataset);
  auto [model, is_test, world_offset] = read_scene_model(dataset, folders);
  ScenePlan plan;
  plan.is_test = std::move(is_test);
  plan.world_offset = world_offset;
  if (world_offset != Vec3d(0.0))
    log_info(
        "the scene lies far from the origin: {} is taken off its coordinates, which single "
        "precision could not hold",
        text_of_offset(world_offset));
  if (dataset.model.empty()) check_registered(model, folders.images);
  plan.masks = find_masks(dataset, folders);
  if (dataset.refine_cameras) {
    plan.refinement = refine_cameras(model, [&](std::size_t done, std::size_t total) {
      if (progress) progress(LoadStage::refinement, done, total);
    });
    log_refinement(*plan.refinement);
  }
  if (dataset.exposure) plan.seen = seen_points(model, "--exposure");
  for (ColmapImage& image : model.images) image.observations = {};  // many bytes, used up
  plan.views = plan_views(dataset, model, folders.images, plan.masks, progress);
  plan.points = single_precision_points(model);
  return plan;
}

/// What is masked, in one line of the log; warns of a mode without masks.
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

/// Puts the views where they belong, but for those with nothing that trains.
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
        "no photo of {} has a pixel to train on: the masks are black everywhere; white is what "
        "trains, so turn them round with --invert-masks, or leave them out with --masks none",
        scene.source));
  log_warning("{} photos are masked everywhere and left out: {}{}", empty.size(), empty.front(),
              empty.size() > 1 ? ", ..." : "");
}

/// Finds the exposures of all views from the points that they share.
ExposureSummary solve_exposures(const ScenePlan& plan, std::vector<View>& views) {
  std::size_t count = 0;
  for (const auto& seen : plan.seen) count += seen.size();
  const std::uint32_t every = std::uint32_t(count / kMostColorSamples + 1);  // of so many points one is sampled
  std::vector<std::vector<ColorSample>> by_view(views.size());
  const auto sample = [&](std::size_t i, const View& view) {
    std::vector<std::uint32_t> seen;
    for (const SeenPoint& point : plan.seen[i])
      if (point.point % every == 0) seen.push_back(point.point);
    by_view[i] = sample_colors(view, std::uint32_t(i), plan.points, seen);
  };
  if (views.front().source)  // whose budget is for one photo in use
    for_each_with_photo(views, views.size(), sample);
  else
    parallel_for(views.size(), 1, [&](std::size_t i) { sample(i, views[i]); });
  std::vector<ColorSample> samples;
  for (const auto& some : by_view) samples.insert(samples.end(), some.begin(), some.end());
  const ExposureFit fit = fit_exposures(samples, plan.is_test);
  for (std::size_t i = 0; i < views.size(); ++i) views[i].exposure = fit.exposures[i];
  for (const std::size_t photo : fit.unknown)
    log_warning(
        "{} shares too few well-exposed points with other photos to know its exposure: it stays as "
        "it is",
        views[photo].name);
  log_exposures(fit);
  return {fit.sample_count, fit.spread_before, fit.spread_after};
}

}  // namespace

void check_scene(const DatasetConfig& dataset) {
  DatasetConfig as_it_is = dataset;
  as_it_is.refine_cameras = false;
  for (const ViewPlan& view : plan_scene(as_it_is, {}).views) single_precision_camera(view);
}

Scene load_scene(const DatasetConfig& dataset, const LoadProgress& progress, PhotoLoading loading) {
  ScenePlan plan = plan_scene(dataset, progress);
  Scene scene;
  scene.source = dataset.source;
  std::vector<View> views =
      make_views(dataset, std::move(plan.views), plan.masks, progress, loading);
  report_masks(views, dataset);
  if (dataset.exposure) scene.exposure = solve_exposures(plan, views);
  split_views(std::move(views), plan.is_test, scene);
  scene.points = std::move(plan.points);
  scene.world_offset = plan.world_offset;
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
