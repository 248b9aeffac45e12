// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/plan_photos.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <tuple>

#include "data_loaders/counted.h"
#include "data_loaders/lenses/lens_range.h"
#include "data_loaders/photos/map_file.h"
#include "data_loaders/photos/photo_fit.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/video/film_frames.h"
#include "gs_core/error.h"
#include "gs_core/math/lens/lens_projection.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/edit/select.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// The size of a mask or map, which has the shape of its photo.
PhotoSize checked_size(const PhotoSize& size, const fs::path& file, const char* noun,
                       const char* remedy, const Photo& photo) {
  if (has_shape_of(size, photo.size)) return size;
  throw Error(
      fmt::format("{} {} has {} x {} pixels, but its photo {} has {} x {}: the shapes differ, so "
                  "it was made for "
                  "another picture; make it again from this photo, or {}",
                  noun, file.string(), size.width, size.height, photo.file.string(),
                  photo.size.width, photo.size.height, remedy));
}

/// The model's camera at the size of the photo file.
LensCamera fitted_to_photo(ColmapCamera camera, const Photo& photo) {
  const PhotoSize model = {camera.width, camera.height}, size = photo.size;
  const PhotoFit fit = fit_of(size, model);
  if (fit == PhotoFit::fits) {
    if (camera.model == CameraModel::equirectangular)
      camera.width = size.width, camera.height = size.height;
    LensCamera lens = lens_camera(camera, photo.name);
    if (!lens.is_hemisphere()) lens.pinhole = resized(lens.pinhole, size.width, size.height);
    return lens;
  }
  throw Error(fmt::format(
      "photo {} has {} x {} pixels, but its camera in the model {} x {}: {}", photo.file.string(),
      size.width, size.height, model.width, model.height,
      fit == PhotoFit::turned
          ? "width and height are swapped, so one of the two was turned by the photo's EXIF "
            "orientation; turn the pixels themselves (`mogrify -auto-orient` on copies of the "
            "photos) and give COLMAP and gemsplat these same files"
          : "the shapes differ, so this is not the photo that COLMAP saw; use the same photos, or "
            "run COLMAP again on these"));
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
PinholeCamera<double> training_camera(const Photo& photo, int resolution) {
  const auto [width, height] = photo.size;
  if (resolution == 0 && std::max(width, height) <= kUsualSide) return photo.undistorted;
  return at_resolution(photo.undistorted, resolution);
}

/// Depth maps hold depths along the axis, views through wide lenses have those along rays.
void check_depth_through_lens(const Photo& photo) {
  if (photo.depth_file.empty()) return;
  if (photo.undistorted.has_rolling_shutter())
    throw Error(fmt::format(
        "the camera of photo {} moved while its rows were exposed, and depth map {} is of one "
        "pose; train without maps (--set dataset.depth=none), or without the motion (--set "
        "dataset.rolling_shutter=false)",
        photo.file.string(), photo.depth_file.string()));
  if (!is_wide(photo.undistorted.lens)) return;
  throw Error(fmt::format(
      "photo {} trains through its wide lens, and depth map {} is for pinholes; train without maps "
      "(--set dataset.depth=none), or with undistorted photos (--set dataset.lens=undistort)",
      photo.file.string(), photo.depth_file.string()));
}

Camera single_precision_camera(const Photo& photo, const ColmapImage& image) {
  PinholeCamera<double> posed = photo.target;
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
bool may_be_masked(const Photo& photo) {
  const std::string ending = lowercase_ending(photo.file);
  return !photo.mask_file.empty() || !photo.is_explained ||
         (photo.masks.use_alpha && !photo.is_frame && ending != ".jpg" && ending != ".jpeg");
}

/// Bytes that a decoder of videos holds for a pixel: up to 16 frames of 1.5 bytes that later ones
/// refer to, and a picture of 3 bytes before it is turned into ours.
constexpr std::size_t kBytesOfDecoder = 16 * 3 / 2 + 3;

// Most for a pixel of a map being read: as it stands in the file, as floats, and as those it takes.
constexpr std::size_t kBytesOfDepth = 3 * sizeof(float), kBytesOfNormals = 11 * sizeof(float);

template <class Size>
std::size_t pixels(const Size& size) {
  return std::size_t(size.width) * std::size_t(size.height);
}

/// Bytes of the photo with its mask, and the most that make_picture() holds at a time.
PhotoCost cost_of(const Photo& photo) {
  const std::size_t channels = photo.may_be_masked ? 4 : 3;
  const std::size_t decoded = channels * pixels(photo.size),
                    undistorted = channels * pixels(photo.undistorted),
                    target = channels * pixels(photo.target);
  PhotoCost cost{target, channels == 4 ? 2 * decoded : decoded};  // as decoded, and then apart
  if (photo.is_frame) cost.decoding += kBytesOfDecoder * pixels(photo.size);
  if (photo.is_undistorted()) cost.decoding = std::max(cost.decoding, decoded + undistorted);
  if (photo.lens.is_hemisphere())
    cost.decoding = std::max(cost.decoding, 2 * decoded + undistorted);
  if (photo.is_resized()) cost.decoding = std::max(cost.decoding, undistorted + target);
  // Maps are read when the photo is ready.
  const auto add_map = [&](std::size_t bytes, std::size_t reading, const PhotoSize& size) {
    cost.held += bytes * pixels(photo.target);
    cost.decoding = std::max(cost.decoding, cost.held + reading * pixels(size));
  };
  if (!photo.depth_file.empty()) add_map(sizeof(float), kBytesOfDepth, photo.depth_size);
  if (!photo.normal_file.empty()) add_map(3, kBytesOfNormals, photo.normal_size);
  return cost;
}

/// The size of a photo, or of the video that it is a frame of. A video is opened once.
class PhotoSizes {
 public:
  PhotoSize of(const Photo& photo) {
    if (!photo.is_frame) return read_photo_size(photo.file);
    const std::lock_guard lock(mutex_);
    const auto [known, is_new] = of_videos_.try_emplace(photo.file);
    if (is_new) {
      const Image8 first = read_frame(photo.file, 0);
      known->second = {first.width, first.height};
    }
    return known->second;
  }

 private:
  std::mutex mutex_;
  std::map<fs::path, PhotoSize> of_videos_;
};

void read_headers(std::vector<Photo>& photos,
                  const std::function<void(std::size_t, std::size_t)>& progress) {
  constexpr std::size_t kHeadersPerChunk = 8;
  PhotoSizes sizes;
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(photos.size(), kHeadersPerChunk, [&](std::size_t i) {
    Photo& photo = photos[i];
    photo.size = sizes.of(photo);
    if (!photo.mask_file.empty())
      checked_size(read_photo_size(photo.mask_file), photo.mask_file, "mask", "remove it", photo);
    if (!photo.depth_file.empty())
      photo.depth_size =
          checked_size(read_map_size(kDepthMap, photo.depth_file), photo.depth_file, kDepthMap.noun,
                       "train without maps (--set dataset.depth=none)", photo);
    if (!photo.normal_file.empty())
      photo.normal_size =
          checked_size(read_map_size(kNormalMap, photo.normal_file), photo.normal_file,
                       kNormalMap.noun, "train without maps (--set surface.prior_weight=0)", photo);
    const std::lock_guard lock(mutex);
    if (progress) progress(++done, photos.size());
  });
}

}  // namespace

void plan_photos(SceneModel& scene, LensUse lens, int resolution,
                 const std::function<void(std::size_t done, std::size_t total)>& progress) {
  read_headers(scene.photos, progress);
  const std::vector<std::size_t> frames = frame_numbers(scene.model);
  std::size_t scaled = 0, wide = 0, moving = 0;
  struct Trained {
    PinholeCamera<double> camera;
    bool is_explained;
  };
  std::map<std::tuple<std::uint32_t, int, int, bool>, Trained> trained;
  for (std::size_t i = 0; i < scene.photos.size(); ++i) {
    Photo& photo = scene.photos[i];
    const ColmapImage& image = scene.model.images[i];
    const ColmapCamera& camera = scene.model.cameras.at(image.camera_id);
    photo.camera_id = image.camera_id;
    photo.rig_frame = std::uint32_t(frames[i]) + 1;
    photo.lens = fitted_to_photo(camera, photo);
    const auto [width, height] = photo.size;
    if (width != camera.width || height != camera.height) ++scaled;
    const bool moves = image.motion.is_any();
    const auto [found, is_new] = trained.try_emplace({camera.id, width, height, moves});
    if (is_new) {  // a search: once each
      const auto seen = (moves ? row_by_row_camera : trained_camera)(photo.lens, lens, photo.name);
      const bool bends = seen.has_lens() && photo.lens.lens != Lens::none;
      found->second = {seen, !bends || explains_all_pixels(photo.lens, seen.lens)};
    }
    photo.undistorted = found->second.camera;
    if (moves) photo.undistorted = with_motion(photo.undistorted, image.motion);
    moving += moves;
    wide += photo.undistorted.has_lens() && !photo.lens.is_hemisphere() && !moves;
    photo.is_explained = found->second.is_explained;
    check_depth_through_lens(photo);
    check_resolution(resolution, photo.undistorted, photo.name);
    photo.target = training_camera(photo, resolution);
    photo.camera = single_precision_camera(photo, image);
    photo.may_be_masked = may_be_masked(photo);
    photo.cost = cost_of(photo);
  }
  if (wide && lens == LensUse::automatic)
    log_info("{} through their lens, because a pinhole would not show all that they do",
             counted(wide, "photo", "trains", "train"));
  if (moving)
    log_info("{} row by row by a camera that moved: each row is seen from its own pose",
             counted(moving, "photo", "was taken", "were taken"));
  if (scaled)
    log_info(
        "{} of {} photos differ in size from their cameras in the model: intrinsics scaled to the "
        "photos",
        scaled, scene.photos.size());
}

void find_shown_points(SceneModel& scene) {
  if (has_tracks(scene.model)) {
    const auto seen = seen_points(scene.model, "dataset.photo_list");
    for (std::size_t i = 0; i < seen.size(); ++i)
      for (const SeenPoint& point : seen[i]) scene.photos[i].shown.push_back(point.point);
    return;
  }
  parallel_for(scene.photos.size(), 1, [&](std::size_t i) {
    Photo& photo = scene.photos[i];
    for (std::uint32_t p = 0; p < scene.points.size(); ++p)
      if (is_in_picture(photo.camera, scene.points[p].position)) photo.shown.push_back(p);
  });
}

void leave_out_depth(Photo& photo) {
  photo.depth_file.clear();
  photo.cost = cost_of(photo);
}

void read_exposure_stops(std::vector<Photo>& photos) {
  parallel_for(photos.size(), 8, [&](std::size_t i) {
    if (!photos[i].is_frame) photos[i].exposure_stops = read_exposure_stops(photos[i].file);
  });
}

}  // namespace gs
