// SPDX-License-Identifier: Apache-2.0
#include "gs_train/initialize/looked_at.h"

#include <algorithm>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>

#include "gs_core/geometry/seen_pixel.h"
#include "gs_core/math/render/projection.h"

namespace gs {
namespace {

// Of the mean matrix of the equations. Two axes at an angle of 7 degrees have twice as much.
constexpr double kLeastDeterminant = 2e-3;
constexpr double kSeenShare = 0.9;  // of the cameras

// The direction in which a camera looks.
Vec3d axis_of(const Camera& camera) { return Vec3d(camera.cam_from_world_rotation.row2); }

// The point p that minimizes sum |(I - a a^T) (p - e)|^2 over the axes a through the positions e.
std::optional<Vec3d> nearest_to_axes(const std::vector<View>& views) {
  glm::dmat3 sum(0.0);
  Vec3d right(0.0);
  for (const View& view : views) {
    const Vec3d axis = axis_of(view.camera);
    const glm::dmat3 across = glm::dmat3(1.0) - glm::outerProduct(axis, axis);
    sum += across;
    right += across * Vec3d(view.camera.position());
  }
  const double count = double(views.size());
  if (!(glm::determinant(sum / count) > kLeastDeterminant)) return std::nullopt;
  return glm::inverse(sum) * right;
}

// Half of the smaller side of a picture at the distance of the point.
float half_side_at(const Camera& camera, const Vec3f& point) {
  const float depth = to_camera(camera, point).z;
  return depth * std::min(float(camera.width) / camera.fx, float(camera.height) / camera.fy) / 2;
}

}  // namespace

std::optional<LookedAt> looked_at(const std::vector<View>& views) {
  const std::optional<Vec3d> nearest = nearest_to_axes(views);
  if (!nearest) return std::nullopt;
  const Vec3f center(*nearest);
  std::vector<float> half_sides;
  for (const View& view : views)
    if (seen_pixel(view.camera, center)) half_sides.push_back(half_side_at(view.camera, center));
  if (double(half_sides.size()) < kSeenShare * double(views.size())) return std::nullopt;
  const auto middle = half_sides.begin() + std::ptrdiff_t(half_sides.size() / 2);
  std::nth_element(half_sides.begin(), middle, half_sides.end());
  return LookedAt{center, *middle};
}

}  // namespace gs
