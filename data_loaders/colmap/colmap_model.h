// SPDX-License-Identifier: Apache-2.0
// A COLMAP sparse model as it is on disk: cameras with their lens models, posed images, points. The
// two encodings are read in colmap_binary.cpp and colmap_text.cpp; scene/ makes training views of
// it.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "gs_core/lens.h"
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

/// COLMAP's name of a camera model, and its number of parameters.
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

/// The place of a point in a photo.
struct ColmapObservation {
  std::uint64_t point_id = 0;
  double x = 0, y = 0;  // pixels of the camera's size, the center of the first at (0.5, 0.5)
};

/// One posed image. Of its 2D points, those that belong to a point are kept with Tracks::read.
struct ColmapImage {
  std::uint32_t id = 0;
  std::string name;  // path relative to the images folder, "/" between folders
  std::uint32_t camera_id = 0;
  Quat<double> cam_from_world_rotation{1, 0, 0, 0};  // unit length
  Vec3d cam_from_world_translation{0.0, 0.0, 0.0};   // world units
  std::vector<ColmapObservation> observations{};     // empty unless asked for
  std::filesystem::path mask{};                      // of the photo, if the model names one
  std::filesystem::path depth{};                     // the same of its depth map
  double time = 0;                                   // when it was taken: Camera::time
  RigidMotion<double> motion{};                      // of a rolling shutter: CameraLens::motion
};

/// One triangulated point. Of its track only the length is kept.
struct ColmapPoint {
  std::uint64_t id = 0;
  Vec3d position{0.0, 0.0, 0.0};               // world units
  std::array<std::uint8_t, 3> color{0, 0, 0};  // sRGB
  double error = 0;                            // mean reprojection error, pixels; as the file says
  std::uint64_t observations = 0;              // photos that it was found in
};

/// One camera of a rig and its place on it.
struct ColmapRigCamera {
  std::uint32_t camera_id = 0;
  bool has_pose = false;  // its place is known; the rig's first camera is the origin
  Quat<double> cam_from_rig_rotation{1, 0, 0, 0};  // unit length
  Vec3d cam_from_rig_translation{0.0, 0.0, 0.0};   // world units
};

/// Cameras that are fixed to one another (COLMAP 3.12 and later). Other sensors are skipped.
struct ColmapRig {
  std::uint32_t id = 0;
  std::vector<ColmapRigCamera> cameras;  // in the file's order
};

/// The photos that the cameras of a rig took at one moment.
struct ColmapFrame {
  std::uint32_t id = 0;
  std::uint32_t rig_id = 0;
  std::vector<std::uint64_t> image_ids;  // the model may lack some; no image is in two frames
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

/// Whether to read the observations of a model, which are most of its bytes.
enum class Tracks { skip, read };

/// Whether a folder holds cameras and images, both binary or both text.
bool is_colmap_model(const std::filesystem::path& folder);

/// Throws Error where a folder of `scene` that may hold a model may not be read: it is no folder
/// without a model.
void check_models_are_visible(const std::filesystem::path& scene);

/// The models among the folders in a folder, sorted; none if it cannot be read.
std::vector<std::filesystem::path> colmap_models_in(const std::filesystem::path& folder);

/// The number of images of a model, without reading it whole: the count at the head of images.bin,
/// or the lines of images.txt. Throws Error.
std::uint64_t count_colmap_images(const std::filesystem::path& folder);

/// Reads cameras, images, points3D, rigs and frames: the .bin files where cameras.bin and
/// images.bin exist, else the .txt files. The last three may be absent. Points without a finite
/// position and rigs that cannot be read are left out with a warning. Tracks::read keeps the
/// images' observations with a finite place; the model may lack a point of theirs. Throws Error
/// that names the file, the place in it and the remedy. A damaged file never costs more memory than
/// its size (twice its size with tracks).
ColmapModel read_colmap_model(const std::filesystem::path& folder, Tracks tracks = Tracks::skip);

}  // namespace gs
