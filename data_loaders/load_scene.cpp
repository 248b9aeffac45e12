// SPDX-License-Identifier: Apache-2.0
// Stages, in order: find, read the model, split, plan every view from the photos' headers, decode.
#include "data_loaders/load_scene.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <mutex>
#include <tuple>

#include "data_loaders/colmap_model.h"
#include "data_loaders/find_scene.h"
#include "data_loaders/photo_fit.h"
#include "data_loaders/photo_names.h"
#include "data_loaders/photos.h"
#include "data_loaders/refine_cameras.h"
#include "data_loaders/refine_exposure.h"
#include "data_loaders/scene_model.h"
#include "data_loaders/tracks.h"
#include "data_loaders/undistort.h"
#include "data_loaders/world_offset.h"
#include "gs_core/error.h"
#include "gs_core/log.h"
#include "gs_core/math/rotation.h"
#include "gs_core/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// In all photos together: the rest would tell nothing new of three numbers per photo.
constexpr std::size_t kMostColorSamples = 1000000;

/// All that is known of a view before its photo is decoded.
struct ViewPlan {
  ColmapImage image;
  fs::path file;
  PhotoSize photo_size;
  LensCamera lens;                    // at the photo's size
  PinholeCamera<double> undistorted;  // the photo without its lens, at full resolution
  PinholeCamera<double> target;       // as it is trained on
};

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
                                 const fs::path& images) {
  std::vector<std::string> names;
  for (const ColmapImage& image : model.images) {
    check_name(image, model.folder);
    names.push_back(image.name);
  }
  const std::vector<fs::path> files = find_photos(names, images);
  std::vector<ViewPlan> plans;
  for (std::size_t i = 0; i < names.size(); ++i)
    plans.push_back({model.images[i], files[i], {}, {}, {}, {}});
  constexpr std::size_t kHeadersPerChunk = 8;
  parallel_for(plans.size(), kHeadersPerChunk,
               [&](std::size_t i) { plans[i].photo_size = read_photo_size(plans[i].file); });

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

View load_view(const ViewPlan& plan) {
  View view;
  view.name = plan.image.name;
  view.camera = single_precision_camera(plan);
  view.photo = read_photo(plan.file);
  if (view.photo.width != plan.photo_size.width || view.photo.height != plan.photo_size.height)
    throw Error(fmt::format("photo {} has changed while the scene was loaded; start again",
                            plan.file.string()));
  if (plan.lens.lens != LensCamera::Lens::none)
    view.photo = undistorted_photo(view.photo, plan.lens, plan.undistorted, plan.image.name);
  view.photo = area_resized(view.photo, view.camera.width, view.camera.height);
  return view;
}

std::vector<View> load_views(const std::vector<ViewPlan>& plans, const ProgressFn& progress) {
  std::vector<View> views(plans.size());
  std::atomic<bool> has_failed = false;  // then the others need not be decoded
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(plans.size(), 1, [&](std::size_t i) {
    if (has_failed) return;
    try {
      views[i] = load_view(plans[i]);
    } catch (...) {
      has_failed = true;
      throw;
    }
    const std::lock_guard lock(mutex);
    if (progress) progress(++done, plans.size());
  });
  return views;
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
      "exposures from {} colours of shared points: {:.2f} to {:.2f}; a point's colours differ by "
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

ScenePlan plan_scene(const DatasetConfig& dataset, const ProgressFn& refinement_progress = {}) {
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
  if (dataset.refine_cameras) {
    plan.refinement = refine_cameras(model, refinement_progress);
    log_refinement(*plan.refinement);
  }
  if (dataset.exposure) plan.seen = seen_points(model, "--exposure");
  for (ColmapImage& image : model.images) image.observations = {};  // many bytes, used up
  plan.views = plan_views(dataset, model, folders.images);
  plan.points = single_precision_points(model);
  return plan;
}

/// Finds the exposures of all views from the points that they share.
ExposureSummary solve_exposures(const ScenePlan& plan, std::vector<View>& views) {
  std::size_t count = 0;
  for (const auto& seen : plan.seen) count += seen.size();
  const std::uint32_t every = std::uint32_t(count / kMostColorSamples + 1);  // of so many points one is sampled
  std::vector<std::vector<ColorSample>> by_view(views.size());
  parallel_for(views.size(), 1, [&](std::size_t i) {
    std::vector<std::uint32_t> seen;
    for (const SeenPoint& point : plan.seen[i])
      if (point.point % every == 0) seen.push_back(point.point);
    by_view[i] = sample_colors(views[i], std::uint32_t(i), plan.points, seen);
  });
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
  for (const ViewPlan& view : plan_scene(as_it_is).views) single_precision_camera(view);
}

Scene load_scene(const DatasetConfig& dataset, const ProgressFn& progress,
                 const ProgressFn& refinement_progress) {
  ScenePlan plan = plan_scene(dataset, refinement_progress);
  Scene scene;
  scene.source = dataset.source;
  std::vector<View> views = load_views(plan.views, progress);
  if (dataset.exposure) scene.exposure = solve_exposures(plan, views);
  for (std::size_t i = 0; i < views.size(); ++i)
    (plan.is_test[i] ? scene.test_views : scene.train_views).push_back(std::move(views[i]));
  scene.points = std::move(plan.points);
  scene.world_offset = plan.world_offset;
  scene.refinement = plan.refinement;
  scene.extent = camera_extent(scene.train_views);
  for (const std::size_t stray : stray_cameras(scene.train_views))
    log_warning(
        "the camera of {} stands far away from all others; its pose may be wrong, and the scene's "
        "extent leaves it out",
        scene.train_views[stray].name);
  return scene;
}

}  // namespace gs
