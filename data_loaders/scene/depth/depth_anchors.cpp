// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/depth/depth_anchors.h"

#include <algorithm>

#include "data_loaders/scene/depth/depth_map.h"
#include "gs_core/math/render/projection.h"

namespace gs {
namespace {

constexpr std::size_t kLeastAnchors = 20;  // as many as tell scale and shift in spite of errors

const ColmapPoint* find_point(const ColmapModel& model, std::uint64_t id) {
  const auto point =
      std::lower_bound(model.points.begin(), model.points.end(), id,
                       [](const ColmapPoint& a, std::uint64_t wanted) { return a.id < wanted; });
  return point != model.points.end() && point->id == id ? &*point : nullptr;
}

std::vector<DepthAnchor> anchors_of(const ColmapModel& model, const ColmapImage& image,
                                    const Camera& camera) {
  std::vector<DepthAnchor> anchors;
  for (const ColmapObservation& observation : image.observations) {
    const ColmapPoint* const point = find_point(model, observation.point_id);
    if (!point) continue;
    if (const auto anchor = anchor_of(camera, Vec3f(point->position))) anchors.push_back(*anchor);
  }
  return anchors;
}

}  // namespace

std::optional<DepthAnchor> anchor_of(const Camera& camera, const Vec3f& point) {
  const Vec3f p = to_camera(camera, point);
  if (!is_in_sight(camera, p)) return std::nullopt;
  const Vec2f at = pixel_of(camera, p);
  const float x = at.x, y = at.y;
  if (!(x >= 0 && x < float(camera.width) && y >= 0 && y < float(camera.height)))
    return std::nullopt;
  return DepthAnchor{x, y, p.z};
}

void add_depth_anchors(const ColmapModel& model, std::vector<Photo>& photos) {
  for (std::size_t i = 0; i < photos.size(); ++i)
    if (!photos[i].depth_file.empty())
      photos[i].depth_anchors = anchors_of(model, model.images[i], photos[i].camera);
}

bool is_anchored(const Photo& photo) { return photo.depth_anchors.size() >= kLeastAnchors; }

std::optional<DepthFit> anchored_fit(const ImageF& map, const Photo& photo) {
  const DepthKind kind = photo.depth_kind;
  double known = 0;  // anchors
  const DepthTarget target = fitted_depth_target(kind, 1, [&](const DepthTarget* before) {
    DepthSums sums;
    for (const DepthAnchor& anchor : photo.depth_anchors) {
      const float value = depth_at(map, double(anchor.x) - 0.5, double(anchor.y) - 0.5);
      if (is_known_depth(value))
        add_to(sums, depth_sums_of_pixel(kind, double(value), 1, double(anchor.depth), 1, before));
    }
    known = sums.known;
    return sums;
  });
  if (known < double(kLeastAnchors) || !(target.factor > 0)) return std::nullopt;
  return target.fit;
}

void make_metric(ImageF& map, DepthKind kind, const DepthFit& fit) {
  for (float& value : map.pixels) {
    if (!is_known_depth(value)) continue;
    const double t = inverse_depth_of(kind, fit, double(value));
    value = t > 0 ? float(1 / t) : 0.0f;
  }
}

}  // namespace gs
