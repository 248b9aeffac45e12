// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geometry/scene_sight.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/geometry/seen_pixel.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kEnoughPoints = 100;  // fewer may lie outside of honest pictures
// The order of points in a file often follows the photos. Points are therefore visited in steps, so
// that a camera soon meets one that it sees.
constexpr std::size_t kStride = 61;
constexpr std::size_t kDepthsOfAView = 1000;  // a sample
constexpr double kFarFromPlane = 100;  // proposed planes leave this factor to the median distance

enum class Place { behind, too_near, too_far, beside, in_sight };

Place place_of(const Camera& camera, const FrustumLimits<float>& frustum, const Vec3f& point,
               const DepthLimits& limits) {
  const Vec3f p = to_camera(camera, point);
  const float depth = depth_of(camera, p);
  if (!(depth > 0)) return Place::behind;
  if (depth < limits.near_plane) return Place::too_near;
  if (depth > limits.far_plane) return Place::too_far;
  if (camera.has_lens()) return seen_pixel(camera, point) ? Place::in_sight : Place::beside;
  const float x = p.x / p.z, y = p.y / p.z;
  const bool is_inside =
      x >= frustum.low.x && x <= frustum.high.x && y >= frustum.low.y && y <= frustum.high.y;
  return is_inside ? Place::in_sight : Place::beside;
}

// What one camera sees.
struct ViewSight {
  std::size_t counts[5] = {};  // by Place; of all points if none is in sight
  std::vector<float> depths;   // some, of points in front

  std::size_t count(Place place) const { return counts[std::size_t(place)]; }
};

ViewSight view_sight(const Camera& camera, Span<const Vec3f> points, const DepthLimits& limits) {
  ViewSight sight;
  const FrustumLimits<float> frustum = frustum_limits(camera);
  for (std::size_t first = 0; first < kStride; ++first)
    for (std::size_t i = first; i < points.size; i += kStride) {
      const Place place = place_of(camera, frustum, points[i], limits);
      ++sight.counts[std::size_t(place)];
      if (place == Place::in_sight) {
        sight.depths = {};
        return sight;
      }
      if (place != Place::behind && sight.depths.size() < kDepthsOfAView)
        sight.depths.push_back(depth_of(camera, to_camera(camera, points[i])));
    }
  return sight;
}

double median(std::vector<float>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void add(const ViewSight& view, SceneSight& sight, std::vector<float>& depths) {
  const bool is_seeing = view.count(Place::in_sight) > 0;
  sight.views_with_points_in_sight += is_seeing;
  sight.views_with_points_ahead += is_seeing || view.count(Place::beside) > 0;
  if (is_seeing) return;
  sight.behind += view.count(Place::behind);
  sight.too_near += view.count(Place::too_near);
  sight.too_far += view.count(Place::too_far);
  sight.beside += view.count(Place::beside);
  depths.insert(depths.end(), view.depths.begin(), view.depths.end());
}

std::string reason_of(const SceneSight& sight, const DepthLimits& limits) {
  // A camera inside a room has half of the points behind it, however well it is placed.
  const std::size_t ahead = sight.too_near + sight.too_far + sight.beside;
  const bool look_away = sight.behind > 9 * ahead;
  const std::size_t most =
      look_away ? sight.behind : std::max({sight.too_near, sight.too_far, sight.beside});
  if (!look_away && most == sight.too_near)
    return fmt::format(
        "most points in front of them are nearer than render.near_plane = {:g}, at about {:.2g}; "
        "try --set render.near_plane={:.1g}",
        limits.near_plane, sight.distance, sight.distance / kFarFromPlane);
  if (!look_away && most == sight.too_far)
    return fmt::format(
        "most points are farther away than render.far_plane = {:g}, at about {:.2g}; try --set "
        "render.far_plane={:.1g}",
        limits.far_plane, sight.distance, sight.distance * kFarFromPlane);
  return fmt::format(
      "most points lie {} them; check the poses, whose camera axes are x right, y down, z forward "
      "in a COLMAP model, and that the points have the coordinates of the cameras",
      look_away ? "behind" : "beside");
}

}  // namespace

bool SceneSight::is_doubtful() const {
  return points >= kEnoughPoints && 2 * views_with_points_in_sight < views;
}

SceneSight scene_sight(const std::vector<Camera>& cameras, Span<const Vec3f> points,
                       const DepthLimits& limits) {
  std::vector<ViewSight> views(cameras.size());
  parallel_for(cameras.size(), 1,
               [&](std::size_t i) { views[i] = view_sight(cameras[i], points, limits); });
  SceneSight sight;
  sight.points = points.size;
  sight.views = cameras.size();
  std::vector<float> depths;
  for (const ViewSight& view : views) add(view, sight, depths);
  sight.distance = median(depths);
  return sight;
}

std::string text_of(const SceneSight& sight, const DepthLimits& limits) {
  const std::size_t seeing = sight.is_blind() ? 0 : sight.views_with_points_in_sight;
  return fmt::format("{} of {} views see{} any of the {} points: {}",
                     seeing == 0 ? "none" : fmt::to_string(seeing), sight.views,
                     seeing == 1 ? "s" : "", sight.points, reason_of(sight, limits));
}

}  // namespace gs
