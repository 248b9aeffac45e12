// SPDX-License-Identifier: Apache-2.0
// The camera models' table, the checks that both encodings share, and the choice between the two.
#include "data_loaders/colmap/colmap_model.h"

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>

#include "data_loaders/colmap/colmap_files.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"

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

/// Pixels. A picture with a longer side means that the file is damaged.
constexpr std::uint64_t kLongestSide = 1 << 20;

bool has_pair(const fs::path& folder, const char* extension) {
  std::error_code ignored;
  return fs::is_regular_file(folder / ("cameras" + std::string(extension)), ignored) &&
         fs::is_regular_file(folder / ("images" + std::string(extension)), ignored);
}

/// Gives the rotation unit length. Returns the fault of the pose, "" if there is none.
std::string check_pose(Quat<double>& q, const Vec3d& t) {
  const double length = std::sqrt(squared_norm(q));
  if (!std::isfinite(length) || !is_finite(t)) return "the pose has a number that is not finite";
  if (!(length > 1e-8)) return "the rotation is a zero quaternion";
  q = {q.w / length, q.x / length, q.y / length, q.z / length};
  return "";
}

/// Some programs write `nan` and `-nan(ind)` for points that they could not place.
void leave_out_bad_points(ColmapModel& model, const fs::path& file) {
  const std::size_t count = model.points.size();
  const std::size_t bad = std::erase_if(
      model.points, [](const ColmapPoint& point) { return !is_finite(point.position); });
  if (bad)
    log_warning("{} of {} points in {} have a position that is not finite: left out", bad, count,
                file.string());
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

std::string ModelBuilder::add_camera(ColmapCamera camera, std::uint64_t width,
                                     std::uint64_t height) {
  if (width == 0 || height == 0 || width > kLongestSide || height > kLongestSide)
    return fmt::format("camera {} has the picture size {} x {}", camera.id, width, height);
  for (double param : camera.params)
    if (!std::isfinite(param))
      return fmt::format("camera {} has a parameter that is not a finite number", camera.id);
  camera.width = int(width);
  camera.height = int(height);
  const std::uint32_t id = camera.id;
  if (!model_.cameras.emplace(id, std::move(camera)).second)
    return fmt::format("camera id {} occurs twice", id);
  return "";
}

std::string ModelBuilder::add_image(ColmapImage image) {
  if (image.name.empty()) return fmt::format("image {} has no name", image.id);
  const std::string fault =
      check_pose(image.cam_from_world_rotation, image.cam_from_world_translation);
  if (!fault.empty()) return fmt::format("image '{}': {}", image.name, fault);
  if (!model_.cameras.count(image.camera_id))
    return fmt::format("image '{}' names camera {}, which is not in the cameras file", image.name,
                       image.camera_id);
  if (!image_ids_.insert(image.id).second) return fmt::format("image id {} occurs twice", image.id);
  if (!image_names_.insert(image.name).second)
    return fmt::format("image name '{}' occurs twice", image.name);
  model_.images.push_back(std::move(image));
  return "";
}

std::string ModelBuilder::add_rig(ColmapRig rig) {
  if (!rig_ids_.insert(rig.id).second) return fmt::format("rig id {} occurs twice", rig.id);
  for (ColmapRigCamera& camera : rig.cameras) {
    const std::string fault =
        check_pose(camera.cam_from_rig_rotation, camera.cam_from_rig_translation);
    if (!fault.empty())
      return fmt::format("camera {} of rig {}: {}", camera.camera_id, rig.id, fault);
  }
  model_.rigs.push_back(std::move(rig));
  return "";
}

std::string ModelBuilder::add_frame(ColmapFrame frame) {
  if (!frame_ids_.insert(frame.id).second) return fmt::format("frame id {} occurs twice", frame.id);
  for (std::uint64_t image : frame.image_ids)
    if (!framed_image_ids_.insert(image).second)
      return fmt::format("image {} belongs to frame {} and to one before it", image, frame.id);
  model_.frames.push_back(std::move(frame));
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

void check_models_are_visible(const fs::path& scene) {
  for (const fs::path& folder :
       {scene, scene / "sparse", scene / "sparse" / "0", scene / "colmap" / "sparse"})
    if (std::error_code ignored;
        fs::is_directory(folder, ignored) && ::access(folder.c_str(), R_OK | X_OK) != 0)
      throw Error(fmt::format("cannot look into the folder {}: {}; check its permissions",
                              folder.string(), std::strerror(EACCES)));
}

std::vector<fs::path> colmap_models_in(const fs::path& folder) {
  std::vector<fs::path> models = entries_of(folder);
  std::erase_if(models, [](const fs::path& entry) { return !is_colmap_model(entry); });
  return models;
}

std::uint64_t count_colmap_images(const fs::path& folder) {
  return has_pair(folder, ".bin") ? colmap::count_binary_images(folder / "images.bin")
                                  : colmap::count_text_images(folder / "images.txt");
}

ColmapModel read_colmap_model(const fs::path& folder, Tracks tracks) {
  const bool binary = has_pair(folder, ".bin");
  if (!binary && !has_pair(folder, ".txt"))
    throw Error(
        fmt::format("{} is not a COLMAP model: it needs cameras.bin and images.bin, or cameras.txt "
                    "and images.txt; name another model with --set dataset.model=FOLDER",
                    folder.string()));
  const auto file = [&](const char* stem) {
    return folder / (std::string(stem) + (binary ? ".bin" : ".txt"));
  };

  ColmapModel model;
  model.folder = folder;
  colmap::ModelBuilder builder(model, tracks);
  (binary ? colmap::read_binary_cameras : colmap::read_text_cameras)(file("cameras"), builder);
  (binary ? colmap::read_binary_images : colmap::read_text_images)(file("images"), builder);
  if (fs::exists(file("points3D")))
    (binary ? colmap::read_binary_points : colmap::read_text_points)(file("points3D"), builder);
  else
    log_warning("{} does not exist: the model has no points", file("points3D").string());
  try {
    if (fs::exists(file("rigs")))
      (binary ? colmap::read_binary_rigs : colmap::read_text_rigs)(file("rigs"), builder);
  } catch (const AccessError&) {
    throw;
  } catch (const Error& error) {  // programs other than COLMAP write them in their own ways
    log_warning("{}; going on without rigs", error.what());
    model.rigs.clear();
  }
  if (fs::exists(file("frames")))
    (binary ? colmap::read_binary_frames : colmap::read_text_frames)(file("frames"), builder);

  leave_out_bad_points(model, file("points3D"));
  std::stable_sort(model.points.begin(), model.points.end(),
                   [](const ColmapPoint& a, const ColmapPoint& b) { return a.id < b.id; });
  return model;
}

}  // namespace gs
