// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/colmap/world_offset.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/geometry/outliers.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/system/files/atomic_file.h"

namespace gs {
namespace {

constexpr double kMostLost = 1e-4;           // of the spread
constexpr double kSingleRounding = 0x1p-24;  // of a number, at most

/// The offset of things that stand about `median`; 0 where single precision keeps them apart.
Vec3d offset_at(const Vec3d& median, double spread, double most_lost) {
  const bool is_near = !(length(median) * kSingleRounding > most_lost * spread);
  if (is_near || !(spread > 0) || !std::isfinite(length(median))) return Vec3d(0.0);
  const double digits = std::floor(std::log10(spread));
  const double step = std::pow(10.0, std::abs(digits));  // a whole number, and exact
  Vec3d offset;
  for (int axis = 0; axis < 3; ++axis)
    offset[axis] = digits >= 0 ? std::round(median[axis] / step) * step
                               : std::round(median[axis] * step) / step;
  return offset + Vec3d(0.0);  // no -0
}

}  // namespace

Vec3d center_of(const ColmapImage& image) {
  return -multiply_transposed(rotation_matrix(image.cam_from_world_rotation),
                              image.cam_from_world_translation);
}

bool are_nearer_to(const Vec3d& offset, const std::vector<Vec3d>& positions) {
  if (offset == Vec3d(0.0)) return false;
  std::size_t nearer = 0;
  for (const Vec3d& at : positions) nearer += inner(at - offset, at - offset) < inner(at, at);
  return 2 * nearer > positions.size();
}

Vec3d world_offset_of(const ColmapModel& model) {
  std::vector<Vec3d> centers, points;
  for (const ColmapImage& image : model.images) centers.push_back(center_of(image));
  if (centers.empty()) return Vec3d(0.0);
  const Vec3d median = median_position(centers);
  double spread = ordinary_distance(median, centers);
  if (!(spread > 0)) {
    for (const ColmapPoint& point : model.points) points.push_back(point.position);
    spread = ordinary_distance(median, points);
  }
  return offset_at(median, spread, kMostLost);
}

Vec3d world_offset_of(const std::vector<Vec3d>& positions, double most_lost) {
  if (positions.empty()) return Vec3d(0.0);
  const Vec3d median = median_position(positions);
  return offset_at(median, ordinary_distance(median, positions), most_lost);
}

void take_off(ColmapModel& model, const Vec3d& offset) {
  for (ColmapImage& image : model.images)
    image.cam_from_world_translation +=
        multiply(rotation_matrix(image.cam_from_world_rotation), offset);
  for (ColmapPoint& point : model.points) point.position -= offset;
}

void bring_to_offset(Scene& scene, const Vec3d& offset) {
  const Vec3d moved = offset - scene.world_offset;
  for (auto* views : {&scene.train_views, &scene.test_views})
    for (View& view : *views) {
      const Mat3<float>& R = view.camera.cam_from_world_rotation;
      const Mat3<double> R_double{Vec3d(R.row0), Vec3d(R.row1), Vec3d(R.row2)};
      view.camera.cam_from_world_translation =
          Vec3f(Vec3d(view.camera.cam_from_world_translation) + multiply(R_double, moved));
    }
  for (ScenePoint& point : scene.points) point.position = Vec3f(Vec3d(point.position) - moved);
  scene.world_offset = offset;
}

std::string text_of_offset(const Vec3d& offset) {
  return fmt::format("{} {} {}", offset.x, offset.y, offset.z);
}

void write_world_offset(const std::filesystem::path& path, const Vec3d& offset) {
  AtomicFile file(path);
  file.write(fmt::format("{{\"world_offset\": [{}, {}, {}]}}\n", offset.x, offset.y, offset.z));
  file.commit();
}

}  // namespace gs
