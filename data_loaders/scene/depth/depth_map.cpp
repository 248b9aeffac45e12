// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/scene/depth/depth_map.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "data_loaders/photos/map_file.h"
#include "data_loaders/scene/depth/depth_anchors.h"
#include "data_loaders/scene/map_positions.h"
#include "gs_core/error.h"
#include "gs_core/math/loss/depth_loss.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr float kOneSurface = 1.1f;  // the largest ratio of neighbors that are interpolated

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

ImageF make_depth(const Photo& photo) {
  const MapFile file = read_depth_file(photo.depth_file);
  if (file.values.width != photo.depth_size.width || file.values.height != photo.depth_size.height)
    throw Error(fmt::format("{} has changed since the scene was loaded; start again",
                            photo.depth_file.string()));
  const bool has_unit = file.has_steps && photo.depth_kind == DepthKind::metric;
  const float unit = has_unit ? photo.depth_unit : 1.0f;
  const MapPositions positions(photo, photo.depth_size);
  ImageF depth(photo.target.width, photo.target.height, 1);
  parallel_for(std::size_t(depth.height), 16, [&](std::size_t y) {
    for (int x = 0; x < depth.width; ++x) {
      const Vec2d at = positions.at(x + 0.5, double(y) + 0.5);
      depth.at(x, int(y), 0) = unit * depth_at(file.values, at.x - 0.5, at.y - 0.5);
    }
  });
  return depth;
}

DepthMap make_depth_map(const Photo& photo) {
  DepthMap map{make_depth(photo), photo.depth_kind};
  if (map.kind == DepthKind::metric) return map;
  if (const std::optional<DepthFit> fit = anchored_fit(map.values, photo)) {
    make_metric(map.values, map.kind, *fit);
    map.kind = DepthKind::metric;
  }
  return map;
}

}  // namespace gs
