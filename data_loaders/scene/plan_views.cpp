// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/plan_views.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <tuple>

#include "data_loaders/lenses/undistort.h"
#include "data_loaders/photos/depth_file.h"
#include "data_loaders/photos/photo_fit.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/video/film_frames.h"
#include "gs_core/error.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Refuses a mask of another shape than its photo, from its header.
void check_mask_size(const fs::path& mask, const fs::path& photo, const PhotoSize& photo_size) {
  const PhotoSize size = read_photo_size(mask);
  if (has_shape_of(size, photo_size)) return;
  throw Error(fmt::format(
      "mask {} has {} x {} pixels, but its photo {} has {} x {}: the shapes differ, so the mask "
      "was made for another picture; make it again from this photo, or remove it",
      mask.string(), size.width, size.height, photo.string(), photo_size.width, photo_size.height));
}

/// The size of a depth map, which has the shape of its photo.
PhotoSize depth_size_of(const ViewPlan& plan) {
  const PhotoSize size = read_depth_size(plan.depth_file);
  if (has_shape_of(size, plan.photo_size)) return size;
  throw Error(fmt::format(
      "depth map {} has {} x {} pixels, but its photo {} has {} x {}: the shapes differ, so the "
      "map "
      "was made for another picture; make it again from this photo, or train without maps (--set "
      "dataset.depth=none)",
      plan.depth_file.string(), size.width, size.height, plan.file.string(), plan.photo_size.width,
      plan.photo_size.height));
}

/// The model's camera at the size of the photo file.
LensCamera fitted_to_photo(LensCamera lens, const ViewPlan& plan) {
  const PhotoSize model = {lens.pinhole.width, lens.pinhole.height}, photo = plan.photo_size;
  const PhotoFit fit = fit_of(photo, model);
  if (fit == PhotoFit::fits) {
    lens.pinhole = resized(lens.pinhole, photo.width, photo.height);
    return lens;
  }
  const std::string sizes =
      fmt::format("photo {} has {} x {} pixels, but its camera in the model {} x {}",
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

/// Refuses a dataset.resolution other than 0, 1, 2, 4, 8 or a width up to that of the photo.
void check_resolution(int resolution, const PinholeCamera<double>& camera,
                      const std::string& name) {
  if (resolution == 0) return;
  const bool divides = resolution == 1 || resolution == 2 || resolution == 4 || resolution == 8;
  if (!divides && resolution <= 8)
    throw UsageError(fmt::format(
        "dataset.resolution is {}; give 1, 2, 4 or 8 to divide the photos' size, a width of at "
        "least 16 pixels, or 0 to reduce large photos only",
        resolution));
  if (!divides && resolution > camera.width)
    throw UsageError(
        fmt::format("dataset.resolution asks for a width of {} pixels, but photo '{}' has {}; give "
                    "at most {}, or 1 for the photos' own size",
                    resolution, name, camera.width, camera.width));
}

/// The view in training. A photo that is not large keeps every pixel, also where it becomes a little
/// larger without its lens.
PinholeCamera<double> training_camera(const ViewPlan& plan, int resolution) {
  const auto [width, height] = plan.photo_size;
  if (resolution == 0 && std::max(width, height) <= kUsualSide) return plan.undistorted;
  return at_resolution(plan.undistorted, resolution);
}

Camera single_precision_camera(const ViewPlan& plan, const ColmapImage& image) {
  PinholeCamera<double> posed = plan.target;
  posed.cam_from_world_rotation = rotation_matrix(image.cam_from_world_rotation);
  posed.cam_from_world_translation = image.cam_from_world_translation;
  posed.time = image.time;
  const Camera camera = camera_as<float>(posed);
  if (!is_finite(camera.position()) || !is_finite(Vec3f(camera.fx, camera.cx, 0)) ||
      !is_finite(Vec3f(camera.fy, camera.cy, 0)))
    throw Error(fmt::format(
        "the camera of photo '{}' does not fit single precision; leave the photo out of the model, "
        "or move the model nearer to its origin with `colmap model_aligner`",
        image.name));
  return camera;
}

/// Neither JPEG nor videos have alpha.
bool may_be_masked(const ViewPlan& plan) {
  const std::string ending = lowercase_ending(plan.file);
  return !plan.mask_file.empty() ||
         (plan.masks.use_alpha && !plan.is_frame && ending != ".jpg" && ending != ".jpeg");
}

/// Bytes that a decoder of videos holds for a pixel: up to 16 frames of 1.5 bytes that later ones
/// refer to, and a picture of 3 bytes before it is turned into ours.
constexpr std::size_t kBytesOfDecoder = 16 * 3 / 2 + 3;

constexpr std::size_t kBytesOfDepth = 3 * sizeof(float);  // most for a pixel of a map being read

template <class Size>
std::size_t pixels(const Size& size) {
  return std::size_t(size.width) * std::size_t(size.height);
}

/// Bytes of the photo with its mask, and the most that make_picture() holds at a time.
PhotoCost cost_of(const ViewPlan& plan) {
  const std::size_t channels = plan.may_be_masked ? 4 : 3;
  const auto bytes = [&](const auto& size) {
    return channels * std::size_t(size.width) * size.height;
  };
  const std::size_t photo = bytes(plan.photo_size), undistorted = bytes(plan.undistorted),
                    target = bytes(plan.target);
  PhotoCost cost{target, channels == 4 ? 2 * photo : photo};  // as decoded, and then apart
  if (plan.is_frame) cost.decoding += kBytesOfDecoder * pixels(plan.photo_size);
  if (plan.has_lens()) cost.decoding = std::max(cost.decoding, photo + undistorted);
  if (plan.is_resized()) cost.decoding = std::max(cost.decoding, undistorted + target);
  if (plan.depth_file.empty()) return cost;
  // The map is read when the photo is ready: as it stands in the file, and as floats.
  cost.held += sizeof(float) * pixels(plan.target);
  cost.decoding = std::max(cost.decoding, cost.held + kBytesOfDepth * pixels(plan.depth_size));
  return cost;
}

/// The size of a photo, or of the video that it is a frame of. A video is opened once.
class PhotoSizes {
 public:
  PhotoSize of(const ViewPlan& plan) {
    if (!plan.is_frame) return read_photo_size(plan.file);
    const std::lock_guard lock(mutex_);
    const auto [known, is_new] = of_videos_.try_emplace(plan.file);
    if (is_new) {
      const Image8 first = read_frame(plan.file, 0);
      known->second = {first.width, first.height};
    }
    return known->second;
  }

 private:
  std::mutex mutex_;
  std::map<fs::path, PhotoSize> of_videos_;
};

/// Names, files and sizes.
std::vector<ViewPlan> read_headers(const SceneModel& scene,
                                   const std::function<void(std::size_t, std::size_t)>& progress) {
  std::vector<ViewPlan> plans(scene.photos.size());
  constexpr std::size_t kHeadersPerChunk = 8;
  PhotoSizes sizes;
  const std::vector<std::size_t> frames = frame_numbers(scene.model);
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(plans.size(), kHeadersPerChunk, [&](std::size_t i) {
    ViewPlan& plan = plans[i];
    plan.name = scene.model.images[i].name;
    plan.camera_id = scene.model.images[i].camera_id;
    plan.rig_frame = std::uint32_t(frames[i]) + 1;
    plan.file = scene.photos[i];
    plan.is_frame = !scene.model.images[i].video.empty();
    plan.frame = scene.model.images[i].frame;
    plan.mask_file = scene.mask_files[i];
    plan.masks = scene.masks;
    plan.photo_size = sizes.of(plan);
    if (!plan.mask_file.empty()) check_mask_size(plan.mask_file, plan.file, plan.photo_size);
    plan.depth_file = scene.depth_files[i];
    plan.depth_kind = scene.depth.kind;
    plan.depth_unit = scene.depth.unit;
    if (!plan.depth_file.empty()) plan.depth_size = depth_size_of(plan);
    const std::lock_guard lock(mutex);
    if (progress) progress(++done, plans.size());
  });
  return plans;
}

}  // namespace

std::vector<ViewPlan> plan_views(
    const SceneModel& scene, int resolution,
    const std::function<void(std::size_t done, std::size_t total)>& progress) {
  std::vector<ViewPlan> plans = read_headers(scene, progress);
  std::size_t scaled = 0;
  std::map<std::tuple<std::uint32_t, int, int>, PinholeCamera<double>> undistorted;
  for (std::size_t i = 0; i < plans.size(); ++i) {
    ViewPlan& plan = plans[i];
    const ColmapImage& image = scene.model.images[i];
    const ColmapCamera& camera = scene.model.cameras.at(image.camera_id);
    plan.lens = fitted_to_photo(lens_camera(camera, plan.name), plan);
    const auto [width, height] = plan.photo_size;
    if (width != camera.width || height != camera.height) ++scaled;
    const auto [found, is_new] = undistorted.try_emplace({camera.id, width, height});
    if (is_new) found->second = undistorted_pinhole(plan.lens, plan.name);  // a search: once each
    plan.undistorted = found->second;
    check_resolution(resolution, plan.undistorted, plan.name);
    plan.target = training_camera(plan, resolution);
    plan.camera = single_precision_camera(plan, image);
    plan.may_be_masked = may_be_masked(plan);
    plan.cost = cost_of(plan);
  }
  if (scaled)
    log_info(
        "{} of {} photos differ in size from their cameras in the model: intrinsics scaled to the "
        "photos",
        scaled, plans.size());
  return plans;
}

void leave_out_depth(ViewPlan& plan) {
  plan.depth_file.clear();
  plan.cost = cost_of(plan);
}

void read_exposure_stops(std::vector<ViewPlan>& plans) {
  parallel_for(plans.size(), 8, [&](std::size_t i) {
    if (!plans[i].is_frame) plans[i].exposure_stops = read_exposure_stops(plans[i].file);
  });
}

}  // namespace gs
