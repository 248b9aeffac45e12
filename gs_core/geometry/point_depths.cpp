// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geometry/point_depths.h"

#include <algorithm>

#include "gs_core/geometry/seen_pixel.h"

namespace gs {
namespace {

constexpr int kCells = 24;                   // along the longer edge of a picture
constexpr std::size_t kFewestPoints = 5;     // in a cell and the eight around it
constexpr std::size_t kWrongPoints = 10;     // one of so many may be wrong, at either end
constexpr std::size_t kMostPoints = 200000;  // of a scene; a part of a denser cloud says as much
constexpr float kHidden = 1.1f;  // times the depth of the farthest points: hidden behind them

}  // namespace

PointDepths::PointDepths(const Camera& camera, const std::vector<ScenePoint>& points)
    : camera_(camera), cell_(float(std::max(camera.width, camera.height)) / kCells),
      columns_(int(float(camera.width) / cell_) + 1), rows_(int(float(camera.height) / cell_) + 1),
      ranges_(std::size_t(columns_) * std::size_t(rows_)) {
  std::vector<std::vector<float>> depths(ranges_.size());
  const std::size_t stride = points.size() / kMostPoints + 1;
  for (std::size_t i = 0; i < points.size(); i += stride)
    if (const auto pixel = seen_pixel(camera, points[i].position))
      depths[cell_of(*pixel)].push_back(to_camera(camera, points[i].position).z);
  std::vector<float> around;
  for (int row = 0; row < rows_; ++row)
    for (int column = 0; column < columns_; ++column) {
      around.clear();
      for (int y = std::max(row - 1, 0); y <= std::min(row + 1, rows_ - 1); ++y)
        for (int x = std::max(column - 1, 0); x <= std::min(column + 1, columns_ - 1); ++x) {
          const std::vector<float>& cell = depths[std::size_t(y * columns_ + x)];
          around.insert(around.end(), cell.begin(), cell.end());
        }
      if (around.size() < kFewestPoints) continue;
      std::sort(around.begin(), around.end());
      const std::size_t wrong = around.size() / kWrongPoints;
      ranges_[std::size_t(row * columns_ + column)] = {around[wrong],
                                                       around[around.size() - 1 - wrong]};
    }
}

std::size_t PointDepths::cell_of(const Vec2f& pixel) const {
  return std::size_t(int(pixel.y / cell_) * columns_ + int(pixel.x / cell_));
}

Sight PointDepths::sight_of(const Vec3f& place, float clearance) const {
  const auto pixel = seen_pixel(camera_, place);
  if (!pixel) return Sight::unknown;
  const Range& range = ranges_[cell_of(*pixel)];
  const float depth = to_camera(camera_, place).z;
  if (range.near == 0 || depth > kHidden * range.far) return Sight::unknown;
  return depth < clearance * range.near ? Sight::through : Sight::witness;
}

}  // namespace gs
