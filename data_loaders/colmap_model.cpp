// SPDX-License-Identifier: Apache-2.0
// The camera models' table, the checks that both encodings share, and the choice between the two.
#include "data_loaders/colmap_model.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <unordered_set>

#include "data_loaders/colmap_files.h"
#include "gs_core/error.h"
#include "gs_core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr CameraModelInfo kCameraModels[kCameraModelCount] = {
    {"SIMPLE_PINHOLE", 3},               // f, cx, cy
    {"PINHOLE", 4},                      // fx, fy, cx, cy
    {"SIMPLE_RADIAL", 4},                // f, cx, cy, k
    {"RADIAL", 5},                       // f, cx, cy, k1, k2
    {"OPENCV", 8},                       // fx, fy, cx, cy, k1, k2, p1, p2
    {"OPENCV_FISHEYE", 8},               // fx, fy, cx, cy, k1..k4
    {"FULL_OPENCV", 12},                 // fx, fy, cx, cy, k1, k2, p1, p2, k3..k6
    {"FOV", 5},                          // fx, fy, cx, cy, omega
    {"SIMPLE_RADIAL_FISHEYE", 4},        // f, cx, cy, k
    {"RADIAL_FISHEYE", 5},               // f, cx, cy, k1, k2
    {"THIN_PRISM_FISHEYE", 12},          // fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx1, sy1
    {"RAD_TAN_THIN_PRISM_FISHEYE", 16},  // fx, fy, cx, cy, k0..k5, p0, p1, s0..s3
    {"SIMPLE_DIVISION", 4},              // f, cx, cy, k
    {"DIVISION", 5},                     // fx, fy, cx, cy, k
    {"SIMPLE_FISHEYE", 3},               // f, cx, cy
    {"FISHEYE", 4},                      // fx, fy, cx, cy
    {"EUCM", 6},                         // fx, fy, cx, cy, alpha, beta
    {"EQUIRECTANGULAR", 2},              // width, height
};

/// A picture's side in pixels may not be longer: what a file says beyond it is damage.
constexpr std::uint64_t kLongestSide = 1 << 20;

bool has_pair(const fs::path& folder, const char* extension) {
  std::error_code ignored;
  return fs::is_regular_file(folder / ("cameras" + std::string(extension)), ignored) &&
         fs::is_regular_file(folder / ("images" + std::string(extension)), ignored);
}

/// The checks that need the whole model.
void check_references(const ColmapModel& model, const fs::path& images_file) {
  std::unordered_set<std::uint32_t> ids;
  std::unordered_set<std::string> names;
  for (const ColmapImage& image : model.images) {
    if (!model.cameras.count(image.camera_id))
      colmap::fail(images_file,
                   fmt::format("image '{}' names camera {}, which the cameras file does not have",
                               image.name, image.camera_id));
    if (!ids.insert(image.id).second)
      colmap::fail(images_file, fmt::format("image id {} occurs twice", image.id));
    if (!names.insert(image.name).second)
      colmap::fail(images_file, fmt::format("image name '{}' occurs twice", image.name));
  }
}

}  // namespace

namespace colmap {

void fail(const fs::path& file, const std::string& what) {
  throw Error(
      fmt::format("cannot read {} in {}: {}; run COLMAP again or name another model with --set "
                  "dataset.model=FOLDER",
                  file.filename().string(), file.parent_path().string(), what));
}

std::optional<CameraModel> camera_model_of(std::string_view name) {
  for (int id = 0; id < kCameraModelCount; ++id)
    if (name == kCameraModels[id].name) return CameraModel(id);
  return std::nullopt;
}

std::string add_camera(ColmapModel& model, ColmapCamera camera, std::uint64_t width,
                       std::uint64_t height) {
  if (width == 0 || height == 0 || width > kLongestSide || height > kLongestSide)
    return fmt::format("camera {} has the picture size {} x {}", camera.id, width, height);
  for (double param : camera.params)
    if (!std::isfinite(param))
      return fmt::format("camera {} has a parameter that is not a finite number", camera.id);
  camera.width = int(width);
  camera.height = int(height);
  const std::uint32_t id = camera.id;
  if (!model.cameras.emplace(id, std::move(camera)).second)
    return fmt::format("camera id {} occurs twice", id);
  return "";
}

std::string add_image(ColmapModel& model, ColmapImage image) {
  if (image.name.empty()) return fmt::format("image {} has no name", image.id);
  Quat<double>& q = image.cam_from_world_rotation;
  const Vec3d& t = image.cam_from_world_translation;
  const double length = std::sqrt(squared_norm(q));
  if (!std::isfinite(length) || !std::isfinite(t.x) || !std::isfinite(t.y) || !std::isfinite(t.z))
    return fmt::format("the pose of image '{}' has a number that is not finite", image.name);
  if (!(length > 1e-8))
    return fmt::format("the rotation of image '{}' is a zero quaternion", image.name);
  q = {q.w / length, q.x / length, q.y / length, q.z / length};
  model.images.push_back(std::move(image));
  return "";
}

std::string add_point(ColmapModel& model, const ColmapPoint& point) {
  const Vec3d& p = point.position;
  if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z))
    return fmt::format("the position of point {} is not finite", point.id);
  model.points.push_back(point);
  return "";
}

}  // namespace colmap

const CameraModelInfo& camera_model_info(CameraModel model) {
  GS_CHECK(int(model) >= 0 && int(model) < kCameraModelCount);
  return kCameraModels[int(model)];
}

bool is_colmap_model(const fs::path& folder) {
  return has_pair(folder, ".bin") || has_pair(folder, ".txt");
}

ColmapModel read_colmap_model(const fs::path& folder) {
  const bool binary = has_pair(folder, ".bin");
  if (!binary && !has_pair(folder, ".txt"))
    throw Error(fmt::format(
        "{} is no COLMAP model: it needs cameras.bin and images.bin, or cameras.txt and "
        "images.txt; name another model with --set dataset.model=FOLDER",
        folder.string()));
  const std::string extension = binary ? ".bin" : ".txt";
  const fs::path images_file = folder / ("images" + extension);
  const fs::path points_file = folder / ("points3D" + extension);

  ColmapModel model;
  model.folder = folder;
  (binary ? colmap::read_binary_cameras : colmap::read_text_cameras)(
      folder / ("cameras" + extension), model);
  (binary ? colmap::read_binary_images : colmap::read_text_images)(images_file, model);
  check_references(model, images_file);
  if (fs::exists(points_file))
    (binary ? colmap::read_binary_points : colmap::read_text_points)(points_file, model);
  else
    log_warning("{} does not exist: the model has no points", points_file.string());
  std::stable_sort(model.points.begin(), model.points.end(),
                   [](const ColmapPoint& a, const ColmapPoint& b) { return a.id < b.id; });
  return model;
}

}  // namespace gs
