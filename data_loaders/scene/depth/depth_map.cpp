// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/depth/depth_map.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "data_loaders/photos/depth_file.h"
#include "data_loaders/scene/depth/depth_anchors.h"
#include "gs_core/error.h"
#include "gs_core/math/loss/depth_loss.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr float kOneSurface = 1.1f;  // the largest ratio of neighbors that are interpolated

/// Where the map of a view has what its camera sees at a pixel. All positions have pixel centers at
/// + 0.5.
class MapPositions {
 public:
  explicit MapPositions(const ViewPlan& plan) : plan_(plan) {}

  Vec2d at(double x, double y) const {
    const PinholeCamera<double>&target = plan_.target, &whole = plan_.undistorted;
    Vec2d photo(x * whole.width / target.width, y * whole.height / target.height);
    if (plan_.has_lens()) {
      const PinholeCamera<double>& lens = plan_.lens.pinhole;
      const Vec2d landed =
          distorted(plan_.lens, {(photo.x - whole.cx) / whole.fx, (photo.y - whole.cy) / whole.fy});
      photo = {lens.fx * landed.x + lens.cx, lens.fy * landed.y + lens.cy};
    }
    return {photo.x * plan_.depth_size.width / plan_.photo_size.width,
            photo.y * plan_.depth_size.height / plan_.photo_size.height};
  }

 private:
  const ViewPlan& plan_;
};

}  // namespace

float depth_at(const ImageF& map, double x, double y) {
  const double column = std::clamp(x, 0.0, double(map.width - 1)),
               row = std::clamp(y, 0.0, double(map.height - 1));
  const int left = int(column), top = int(row);
  const int right = std::min(left + 1, map.width - 1), bottom = std::min(top + 1, map.height - 1);
  const double u = column - left, v = row - top;
  const float values[4] = {map.at(left, top, 0), map.at(right, top, 0), map.at(left, bottom, 0),
                           map.at(right, bottom, 0)};
  const auto [least, most] = std::minmax_element(std::begin(values), std::end(values));
  const bool are_known = std::all_of(std::begin(values), std::end(values), is_known_depth);
  if (are_known && *most < kOneSurface * *least)
    return float((1 - v) * ((1 - u) * double(values[0]) + u * double(values[1])) +
                 v * ((1 - u) * double(values[2]) + u * double(values[3])));
  const float nearest = values[(v < 0.5 ? 0 : 2) + (u < 0.5 ? 0 : 1)];
  return is_known_depth(nearest) ? nearest : 0;
}

ImageF make_depth(const ViewPlan& plan) {
  const DepthFile file = read_depth_file(plan.depth_file);
  if (file.values.width != plan.depth_size.width || file.values.height != plan.depth_size.height)
    throw Error(fmt::format("{} has changed since the scene was loaded; start again",
                            plan.depth_file.string()));
  const bool has_unit = file.has_steps && plan.depth_kind == DepthKind::metric;
  const float unit = has_unit ? plan.depth_unit : 1.0f;
  const MapPositions positions(plan);
  ImageF depth(plan.target.width, plan.target.height, 1);
  parallel_for(std::size_t(depth.height), 16, [&](std::size_t y) {
    for (int x = 0; x < depth.width; ++x) {
      const Vec2d at = positions.at(x + 0.5, double(y) + 0.5);
      depth.at(x, int(y), 0) = unit * depth_at(file.values, at.x - 0.5, at.y - 0.5);
    }
  });
  return depth;
}

DepthMap make_depth_map(const ViewPlan& plan) {
  DepthMap map{make_depth(plan), plan.depth_kind};
  if (map.kind == DepthKind::metric) return map;
  if (const std::optional<DepthFit> fit = anchored_fit(map.values, plan)) {
    make_metric(map.values, map.kind, *fit);
    map.kind = DepthKind::metric;
  }
  return map;
}

}  // namespace gs
