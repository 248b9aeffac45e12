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
#include "data_loaders/masks.h"
#include "data_loaders/photo_fit.h"
#include "data_loaders/photo_names.h"
#include "data_loaders/photos.h"
#include "data_loaders/scene_model.h"
#include "data_loaders/undistort.h"
#include "gs_core/error.h"
#include "gs_core/log.h"
#include "gs_core/math/rotation.h"
#include "gs_core/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// All that is known of a view before its photo is decoded.
struct ViewPlan {
  ColmapImage image;
  fs::path file;
  fs::path mask_file;                 // empty: none
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
                                 const fs::path& images, const MaskSource& masks) {
  std::vector<std::string> names;
  for (const ColmapImage& image : model.images) {
    check_name(image, model.folder);
    names.push_back(image.name);
  }
  const std::vector<fs::path> files = find_photos(names, images);
  const std::vector<fs::path> mask_files = match_masks(masks, names, files);
  std::vector<ViewPlan> plans;
  for (std::size_t i = 0; i < names.size(); ++i)
    plans.push_back({model.images[i], files[i], mask_files[i], {}, {}, {}, {}});
  constexpr std::size_t kHeadersPerChunk = 8;
  parallel_for(plans.size(), kHeadersPerChunk, [&](std::size_t i) {
    plans[i].photo_size = read_photo_size(plans[i].file);
    if (!mask_files[i].empty()) check_mask_size(mask_files[i], plans[i].file, plans[i].photo_size);
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

/// Photo and mask as the view's camera sees them, without anything of what the mask covers.
void fit_to_camera(View& view, const ViewPlan& plan) {
  constexpr int kReach = 4;  // pixels: bicubic weights of the mask reach 2 beyond its edge, those of the photo 2 more
  const bool is_masked = !view.mask.empty();
  const std::string& name = plan.image.name;
  if (plan.lens.lens != LensCamera::Lens::none) {
    if (is_masked) fill_masked_edge(view.photo, view.mask, kReach);
    view.photo = undistorted_photo(view.photo, plan.lens, plan.undistorted, name);
    if (is_masked) view.mask = undistorted_photo(view.mask, plan.lens, plan.undistorted, name);
  }
  const int width = view.camera.width, height = view.camera.height;
  if (is_masked && (width != view.photo.width || height != view.photo.height)) {
    multiply_by_mask(view.photo, view.mask);
    view.mask = area_resized(view.mask, width, height);
    view.photo = area_resized(view.photo, width, height);
    divide_by_mask(view.photo, view.mask);
  } else {
    view.photo = area_resized(view.photo, width, height);
  }
}

View load_view(const ViewPlan& plan, const MaskSource& masks) {
  View view;
  view.name = plan.image.name;
  view.camera = single_precision_camera(plan);
  PhotoWithAlpha read = read_photo_with_alpha(plan.file);
  if (read.photo.width != plan.photo_size.width || read.photo.height != plan.photo_size.height)
    throw Error(fmt::format("photo {} has changed while the scene was loaded; start again",
                            plan.file.string()));
  view.mask = read_mask(masks, plan.mask_file, read);
  view.over_background = masks.over_background && !view.mask.empty();
  view.photo = std::move(read.photo);
  fit_to_camera(view, plan);
  return view;
}

std::vector<View> load_views(const std::vector<ViewPlan>& plans, const MaskSource& masks,
                             const ProgressFn& progress) {
  std::vector<View> views(plans.size());
  std::atomic<bool> has_failed = false;  // then the others need not be decoded
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(plans.size(), 1, [&](std::size_t i) {
    if (has_failed) return;
    try {
      views[i] = load_view(plans[i], masks);
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
  MaskSource masks;
  std::vector<ViewPlan> views;  // sorted by name
  std::vector<bool> is_test;
  std::vector<ScenePoint> points;
};

ScenePlan plan_scene(const DatasetConfig& dataset) {
  const SceneFolders folders = find_scene(dataset);
  auto [model, is_test] = read_scene_model(dataset, folders);
  ScenePlan plan;
  plan.is_test = std::move(is_test);
  if (dataset.model.empty()) check_registered(model, folders.images);
  plan.masks = find_masks(dataset, folders);
  plan.views = plan_views(dataset, model, folders.images, plan.masks);
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
  else if (dataset.mask_mode == "background")
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

}  // namespace

void check_scene(const DatasetConfig& dataset) {
  for (const ViewPlan& view : plan_scene(dataset).views) single_precision_camera(view);
}

Scene load_scene(const DatasetConfig& dataset, const ProgressFn& progress) {
  ScenePlan plan = plan_scene(dataset);
  Scene scene;
  scene.source = dataset.source;
  std::vector<View> views = load_views(plan.views, plan.masks, progress);
  report_masks(views, dataset);
  split_views(std::move(views), plan.is_test, scene);
  scene.points = std::move(plan.points);
  scene.extent = camera_extent(scene.train_views);
  for (const std::size_t stray : stray_cameras(scene.train_views))
    log_warning(
        "the camera of {} stands far away from all others; its pose may be wrong, and the scene's "
        "extent leaves it out",
        scene.train_views[stray].name);
  return scene;
}

}  // namespace gs
