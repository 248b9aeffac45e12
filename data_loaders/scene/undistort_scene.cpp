// SPDX-License-Identifier: Apache-2.0
// Stages, in order: read the model, plan the photos at full size, name the new files, write photos,
// masks and depth maps, write the model.
#include "data_loaders/scene/undistort_scene.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <mutex>
#include <set>
#include <tuple>

#include "data_loaders/colmap/colmap_write.h"
#include "data_loaders/photos/encode/encode_jpeg.h"
#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/photos/exr.h"
#include "data_loaders/photos/photo_codec.h"
#include "data_loaders/photos/photo_names.h"
#include "data_loaders/scene/depth/depth_map.h"
#include "data_loaders/scene/place_scene.h"
#include "data_loaders/scene/plan_photos.h"
#include "data_loaders/scene/view_picture.h"
#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Whether the file itself gives the same view: it has no lens, and loading it without a mask file
/// gives the same mask.
bool is_copied(const Photo& photo) {
  const bool has_only_alpha = photo.mask_file.empty() && photo.masks.use_alpha;
  const std::string ending = lowercase_ending(photo.file);
  return !photo.is_undistorted() && (has_only_alpha || ending == ".jpg" || ending == ".jpeg");
}

/// The names of the new files: the old ones with another ending, or with one more if two would
/// become the same.
std::vector<std::string> new_names(const std::vector<Photo>& photos, bool as_jpeg) {
  const auto ending_of = [&](const Photo& photo) {
    return is_copied(photo) ? photo.file.extension().string() : as_jpeg ? ".jpg" : ".png";
  };
  std::map<std::string, int> uses;
  std::vector<std::string> names;
  for (const Photo& photo : photos) {
    names.push_back(fs::path(photo.name).replace_extension(ending_of(photo)).generic_string());
    ++uses[names.back()];
  }
  for (std::size_t i = 0; i < photos.size(); ++i)
    if (uses[names[i]] > 1) names[i] = photos[i].name + ending_of(photos[i]);
  return names;
}

double psnr_of(const Image8& a, const Image8& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    const double difference = double(a.pixels[i]) - double(b.pixels[i]);
    sum += difference * difference;
  }
  constexpr double kSame = 99;  // dB, for pictures without any difference
  return sum > 0 ? 10 * std::log10(255.0 * 255.0 * double(a.pixels.size()) / sum) : kSame;
}

void copy_photo(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::create_directories(to.parent_path(), error);
  if (!error) fs::copy_file(from, to, error);
  if (error)
    throw Error(
        fmt::format("cannot copy {} to {}: {}; free some space, or name another folder with -o",
                    from.string(), to.string(), error.message()));
}

/// Returns the PSNR of the file against the photo.
double write_jpeg(const fs::path& path, const Image8& photo, int quality) {
  const std::vector<std::uint8_t> bytes = encode_jpeg_alone(photo, quality);
  AtomicFile file(path);
  file.write(bytes.data(), bytes.size());
  file.commit();
  return psnr_of(photo, read_photo(path));
}

/// A pixel of the model's camera as a pixel of the undistorted photo; nothing if no ray of the lens
/// lands there.
std::optional<Vec2d> undistorted_pixel(const ColmapCamera& camera, const Photo& photo, double x,
                                       double y) {
  const PinholeCamera<double>& from = photo.lens.pinhole;  // at the photo's size
  const PinholeCamera<double>& to = photo.undistorted;
  const Vec2d landed((x * from.width / camera.width - from.cx) / from.fx,
                     (y * from.height / camera.height - from.cy) / from.fy);
  const std::optional<Vec2d> ideal = undistorted(photo.lens, landed);
  if (!ideal) return std::nullopt;
  return Vec2d(to.fx * ideal->x + to.cx, to.fy * ideal->y + to.cy);
}

/// The model of the undistorted photos.
ColmapModel pinhole_model(ColmapModel model, const std::vector<Photo>& photos,
                          const std::vector<std::string>& names) {
  const std::map<std::uint32_t, ColmapCamera> lenses = std::move(model.cameras);
  model.cameras.clear();
  std::uint32_t next_id = lenses.empty() ? 1 : lenses.rbegin()->first + 1;
  std::map<std::tuple<std::uint32_t, int, int>, std::uint32_t> id_of;  // per camera and photo size
  for (std::size_t i = 0; i < photos.size(); ++i) {
    ColmapImage& image = model.images[i];
    const ColmapCamera& lens = lenses.at(image.camera_id);
    std::vector<ColmapObservation> observations;
    for (const ColmapObservation& seen : image.observations)
      if (const auto at = undistorted_pixel(lens, photos[i], seen.x, seen.y))
        observations.push_back({seen.point_id, at->x, at->y});
    image.observations = std::move(observations);
    image.name = names[i];
    const PinholeCamera<double>& p = photos[i].undistorted;
    const auto [known, is_new] =
        id_of.try_emplace({lens.id, photos[i].size.width, photos[i].size.height}, lens.id);
    if (is_new) {
      if (model.cameras.contains(lens.id)) known->second = next_id++;
      model.cameras[known->second] = {
          known->second, CameraModel::pinhole, p.width, p.height, {p.fx, p.fy, p.cx, p.cy}};
    }
    image.camera_id = known->second;
  }
  const bool is_split = model.cameras.size() > lenses.size();
  if (is_split && !model.rigs.empty()) {
    log_warning("photos of one camera have several sizes, so its rig is left out of the new model");
    model.rigs.clear();
  }
  return model;
}

/// The depth map of the undistorted photo, in world units where integers have them.
ImageF metric_depth(Photo photo) {
  photo.depth_kind = DepthKind::metric;
  return make_depth(photo);
}

/// Writes photo, mask and depth map of one view. Returns its share of the result.
UndistortedScene write_view(const Photo& photo, const fs::path& out, const std::string& name,
                            int jpeg_quality) {
  UndistortedScene view;
  const fs::path photo_file = out / "images" / name;
  const bool is_copy = is_copied(photo);
  Picture picture;
  if (!is_copy || !photo.mask_file.empty()) picture = make_picture(photo);
  if (is_copy)
    copy_photo(photo.file, photo_file);
  else if (jpeg_quality > 0)
    view.jpeg_psnr = write_jpeg(photo_file, picture.photo, jpeg_quality);
  else
    write_png(photo_file, picture.photo);
  ++(is_copy ? view.copied : view.undistorted);
  if (!picture.mask.empty()) {
    write_png(out / "masks" / (name + ".png"), picture.mask);  // COLMAP's naming
    view.masks = 1;
  }
  if (!photo.depth_file.empty() && can_write_exr()) {
    write_exr(out / "depth" / (name + ".exr"), metric_depth(photo), {"Z"});
    view.depth_maps = 1;
  }
  return view;
}

}  // namespace

UndistortedScene undistort_scene(const DatasetConfig& dataset, const fs::path& out,
                                 int jpeg_quality, const ProgressFn& progress) {
  const OutputLock lock = OutputLock::of_new_folder(out);
  const SceneFolders folders = find_scene(dataset);
  SceneModel scene = read_scene(dataset, folders, Tracks::read);
  find_scene_files(dataset, scene);
  if (scene.is_split_by_files)
    log_warning(
        "the split of {} is not part of a COLMAP model: --eval will hold out every {}th "
        "photo of {} instead",
        folders.model.string(), dataset.test_every, out.string());
  for (const ColmapImage& image : scene.model.images)
    if (image.motion.is_any())
      throw Error(fmt::format(
          "the camera of photo '{}' moved while its rows were exposed, and a COLMAP model has one "
          "pose for each photo; leave the motion out with --set dataset.rolling_shutter=false",
          image.name));
  plan_photos(scene, LensUse::undistort, 1, {});
  const std::vector<Photo>& photos = scene.photos;
  if (!can_write_exr() &&
      std::ranges::any_of(photos, [](const Photo& photo) { return !photo.depth_file.empty(); }))
    log_warning("the depth maps are left out: {}", cannot_write_exr());
  const std::vector<std::string> names = new_names(photos, jpeg_quality > 0);

  UndistortedScene result;
  double psnr = 0;
  std::atomic<bool> has_failed = false;  // then the other photos need not be written
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(photos.size(), 1, [&](std::size_t i) {
    if (has_failed) return;
    UndistortedScene view;
    try {
      view = write_view(photos[i], out, names[i], jpeg_quality);
    } catch (...) {
      has_failed = true;
      throw;
    }
    const std::lock_guard lock(mutex);
    result.undistorted += view.undistorted;
    result.copied += view.copied;
    result.masks += view.masks;
    result.depth_maps += view.depth_maps;
    psnr += view.jpeg_psnr;
    if (progress) progress(++done, photos.size());
  });
  if (jpeg_quality > 0 && result.undistorted > 0)
    result.jpeg_psnr = psnr / double(result.undistorted);
  result.needs_background = photos[0].masks.over_background;
  write_colmap_model(out / "sparse" / "0", pinhole_model(std::move(scene.model), photos, names));
  return result;
}

}  // namespace gs
