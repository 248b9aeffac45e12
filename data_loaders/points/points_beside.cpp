// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/points/points_beside.h"

#include <algorithm>
#include <cmath>

#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/points/point_file.h"
#include "gs_core/error.h"
#include "gs_core/geometry/outliers.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kSample = 2000;   // points that are looked for in the cameras
constexpr double kSeenShare = 0.5;      // of the points, for a file of the same coordinates
constexpr double kFarthest = 1000;      // distance of a point, in spreads of the cameras
constexpr double kBeyondCorners = 1.2;  // lenses show more than their focal length says

/// The folders from that of the file up to the scene's; the file's alone if it is not below it.
std::vector<fs::path> folders_of(const fs::path& scene, const fs::path& file) {
  const fs::path root = fs::absolute(scene / "").lexically_normal().parent_path();
  std::vector<fs::path> folders = {fs::absolute(file).lexically_normal().parent_path()};
  const auto [end, rest] =
      std::mismatch(root.begin(), root.end(), folders[0].begin(), folders[0].end());
  if (end == root.end())
    while (folders.back() != root) folders.push_back(folders.back().parent_path());
  return folders;
}

/// The files of a folder that may be meant.
std::vector<fs::path> candidates_in(const fs::path& folder) {
  std::vector<fs::path> clouds, meshes;
  for (const fs::path& entry : entries_of(folder)) {
    if (!is_file(entry)) continue;
    const PointFileKind kind = point_file_kind(entry);
    if (kind == PointFileKind::points) clouds.push_back(entry);
    if (kind == PointFileKind::mesh) meshes.push_back(entry);
  }
  return clouds.empty() ? meshes : clouds;
}

/// A cone around what a photo shows.
struct Sight {
  Vec3d center, axis;
  double angle = 0;  // between the axis and the corners, radians
};

Sight sight_of(const ColmapImage& image, const ColmapCamera& camera) {
  const Mat3<double> R = rotation_matrix(image.cam_from_world_rotation);
  const double diagonal = std::hypot(camera.width, camera.height);
  const bool sees_all = camera.model == CameraModel::equirectangular;
  return {center_of(image), R.row2,
          sees_all ? 4 : kBeyondCorners * 0.5 * diagonal / camera.params[0]};
}

/// How many of the points at least one camera sees, as a share.
double seen_share(const ColmapModel& cameras, const std::vector<ColmapPoint>& points) {
  std::vector<Sight> sights;
  std::vector<Vec3d> centers;
  for (const ColmapImage& image : cameras.images) {
    sights.push_back(sight_of(image, cameras.cameras.at(image.camera_id)));
    centers.push_back(sights.back().center);
  }
  const double spread = ordinary_distance(median_position(centers), centers);
  const double farthest = spread > 0 ? kFarthest * spread : INFINITY;
  const std::size_t every = points.size() / kSample + 1;
  std::size_t seen = 0, looked_for = 0;
  for (std::size_t i = 0; i < points.size(); i += every, ++looked_for)
    seen += std::any_of(sights.begin(), sights.end(), [&](const Sight& sight) {
      const Vec3d way = points[i].position - sight.center;
      const double distance = length(way);
      return distance < farthest &&
             inner(way, sight.axis) >= distance * std::cos(std::min(sight.angle, 3.1415));
    });
  return double(seen) / double(std::max<std::size_t>(looked_for, 1));
}

std::string names_of(const std::vector<fs::path>& files) {
  std::string text;
  for (const fs::path& file : files) text += (text.empty() ? "" : ", ") + file.filename().string();
  return text;
}

}  // namespace

std::vector<ColmapPoint> points_beside(const ColmapModel& cameras, const fs::path& scene,
                                       const fs::path& file) try {
  for (const fs::path& folder : folders_of(scene, file)) {
    const std::vector<fs::path> files = candidates_in(folder);
    if (files.empty()) continue;
    if (files.size() > 1) {
      log_warning(
          "any of {} in {} could have the points of the scene: none is taken; leave one there",
          names_of(files), folder.string());
      return {};
    }
    std::vector<ColmapPoint> points = read_point_file(files[0]);
    if (const double share = seen_share(cameras, points); share < kSeenShare) {
      log_warning(
          "the cameras see {:.0f} % of the points in {}, so that these have other coordinates: "
          "left out; export cameras and points in the same local coordinates",
          100 * share, files[0].string());
      return {};
    }
    log_info("{} points are those of {}", points.size(), files[0].string());
    return points;
  }
  return {};
} catch (const Error& error) {
  log_warning("{}; going on without points", error.what());
  return {};
}

}  // namespace gs
