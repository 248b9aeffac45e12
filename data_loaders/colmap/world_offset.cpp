// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/colmap/world_offset.h"

#include "gs_core/geometry/outliers.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/rotation.h"

namespace gs {
namespace {

constexpr double kMostLost = 1e-4;  // of the spread
}  // namespace

Vec3d center_of(const ColmapImage& image) {
  return -multiply_transposed(rotation_matrix(image.cam_from_world_rotation),
                              image.cam_from_world_translation);
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
  return world_offset_of(median, spread, kMostLost);
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

}  // namespace gs
