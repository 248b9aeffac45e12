// SPDX-License-Identifier: Apache-2.0
// A COLMAP sparse model as it lies on disk: cameras with their lens models, posed images, points.
// What is made of it for training is the business of load_scene.h; the two encodings are read in
// colmap_binary.cpp and colmap_text.cpp.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "gs_core/types.h"

namespace gs {

/// COLMAP's camera models by their ids in cameras.bin.
enum class CameraModel : int {
  simple_pinhole = 0,
  pinhole = 1,
  simple_radial = 2,
  radial = 3,
  opencv = 4,
  opencv_fisheye = 5,
  full_opencv = 6,
  fov = 7,
  simple_radial_fisheye = 8,
  radial_fisheye = 9,
  thin_prism_fisheye = 10,
  rad_tan_thin_prism_fisheye = 11,
  simple_division = 12,
  division = 13,
  simple_fisheye = 14,
  fisheye = 15,
  eucm = 16,
  equirectangular = 17,
};

/// What COLMAP calls a camera model, and how many parameters it has.
struct CameraModelInfo {
  const char* name;
  int param_count;
};

inline constexpr int kCameraModelCount = 18;
/// Name and parameter count of a model.
const CameraModelInfo& camera_model_info(CameraModel model);

/// One lens and sensor; several images may share it.
struct ColmapCamera {
  std::uint32_t id = 0;
  CameraModel model = CameraModel::pinhole;
  int width = 0, height = 0;   // pixels, both > 0
  std::vector<double> params;  // in COLMAP's order for the model; finite
};

/// Where a photo shows a point.
struct ColmapObservation {
  std::uint64_t point_id = 0;
  double x = 0, y = 0;  // pixels of the camera's size, the center of the first at (0.5, 0.5)
};

/// One posed image. Those of its 2D points that belong to a point are kept where they are asked for.
struct ColmapImage {
  std::uint32_t id = 0;
  std::string name;  // path relative to the images folder, "/" between folders
  std::uint32_t camera_id = 0;
  Quat<double> cam_from_world_rotation{1, 0, 0, 0};  // unit length
  Vec3d cam_from_world_translation{0.0, 0.0, 0.0};   // world units
  std::vector<ColmapObservation> observations{};     // empty unless asked for
  std::filesystem::path mask{};                      // the photo's mask file, where the model names one
};

/// One triangulated point. Of its track only the length is kept.
struct ColmapPoint {
  std::uint64_t id = 0;
  Vec3d position{0.0, 0.0, 0.0};               // world units
  std::array<std::uint8_t, 3> color{0, 0, 0};  // sRGB
  double error = 0;                            // mean reprojection error, pixels; as the file says
  std::uint64_t observations = 0;              // photos that it was found in
};

/// One camera of a rig and where it sits on it.
struct ColmapRigCamera {
  std::uint32_t camera_id = 0;
  bool has_pose = false;  // COLMAP knows its place; the rig's first camera is its origin
  Quat<double> cam_from_rig_rotation{1, 0, 0, 0};  // unit length
  Vec3d cam_from_rig_translation{0.0, 0.0, 0.0};   // world units
};

/// Cameras that are fixed to one another (COLMAP 3.12 and later). Other sensors are passed over.
struct ColmapRig {
  std::uint32_t id = 0;
  std::vector<ColmapRigCamera> cameras;  // in the file's order
};

/// The photos that the cameras of a rig took at one moment.
struct ColmapFrame {
  std::uint32_t id = 0;
  std::uint32_t rig_id = 0;
  std::vector<std::uint64_t> image_ids;  // some may be none of the model's; none is in two frames
};

/// A whole model, checked: every number is finite, every quaternion has unit length, every image's
/// camera exists, and no id or image name occurs twice.
struct ColmapModel {
  std::map<std::uint32_t, ColmapCamera> cameras;  // by id
  std::vector<ColmapImage> images;                // in the file's order
  std::vector<ColmapPoint> points;                // by ascending id
  std::vector<ColmapRig> rigs;                    // in the file's order; empty before COLMAP 3.12
  std::vector<ColmapFrame> frames;                // likewise
  std::filesystem::path folder;
};

/// Whether the observations of a model are wanted: they are most of its bytes.
enum class Tracks { skip, read };

/// Whether a folder holds cameras and images, both binary or both text.
bool is_colmap_model(const std::filesystem::path& folder);

/// The folders inside a folder that are models, sorted; none where it cannot be read.
std::vector<std::filesystem::path> colmap_models_in(const std::filesystem::path& folder);

/// How many images a model has, without reading it whole: from the count at the head of images.bin,
/// or from the lines of images.txt. Throws Error.
std::uint64_t count_colmap_images(const std::filesystem::path& folder);

/// Reads cameras, images, points3D, rigs and frames: the .bin files where cameras.bin and images.bin
/// exist, else the .txt files. The last three may be absent. Points whose position is not finite are
/// left out, and so are rigs that cannot be read, with a warning. The images' observations are kept with Tracks::read only:
/// those whose place is finite; a point of theirs may be none of the model's. Throws Error that names the file, the place in
/// it and the remedy; a damaged file never costs more memory than its size (twice its size with tracks).
ColmapModel read_colmap_model(const std::filesystem::path& folder, Tracks tracks = Tracks::skip);

}  // namespace gs
