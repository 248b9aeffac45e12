// SPDX-License-Identifier: Apache-2.0
#include "gs_train/initialize/downsample_points.h"

#include <algorithm>
#include <limits>

#include "gs_core/math/density/morton.h"

namespace gs {
namespace {

struct Cell {
  std::uint64_t code;  // Morton code; its leading 3 n bits number the cube of level n
  std::uint32_t point;
};

std::vector<Cell> cells_of(const std::vector<ScenePoint>& points) {
  Vec3f low(std::numeric_limits<float>::max()), high(-std::numeric_limits<float>::max());
  for (const ScenePoint& point : points)
    for (int axis = 0; axis < 3 && is_finite(point.position); ++axis) {
      low[axis] = std::min(low[axis], point.position[axis]);
      high[axis] = std::max(high[axis], point.position[axis]);
    }
  const float size =
      std::max({high.x - low.x, high.y - low.y, high.z - low.z, std::numeric_limits<float>::min()});
  std::vector<Cell> cells;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (is_finite(points[i].position))
      cells.push_back({morton_code(points[i].position, low, size), std::uint32_t(i)});
  std::sort(cells.begin(), cells.end(), [](const Cell& a, const Cell& b) {
    return a.code < b.code || (a.code == b.code && a.point < b.point);
  });
  return cells;
}

// The first point of each occupied cube of a level, 0 .. kMortonBits.
std::vector<std::uint32_t> first_points(const std::vector<Cell>& cells, int level) {
  const int shift = 3 * (kMortonBits - level);
  std::vector<std::uint32_t> firsts;
  for (std::size_t i = 0; i < cells.size();) {
    std::uint32_t first = cells[i].point;
    const std::uint64_t cube = cells[i].code >> shift;
    for (; i < cells.size() && cells[i].code >> shift == cube; ++i)
      first = std::min(first, cells[i].point);
    firsts.push_back(first);
  }
  return firsts;
}

}  // namespace

std::vector<ScenePoint> downsampled(const std::vector<ScenePoint>& points, std::size_t budget) {
  if (points.size() <= budget) return points;
  const std::vector<Cell> cells = cells_of(points);
  std::vector<std::uint32_t> kept;
  for (int level = kMortonBits; level >= 0; --level) {
    kept = first_points(cells, level);
    if (kept.size() <= budget) break;
  }
  std::sort(kept.begin(), kept.end());
  std::vector<ScenePoint> result;
  for (const std::uint32_t i : kept) result.push_back(points[i]);
  return result;
}

}  // namespace gs
