// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geometry/outliers.h"

#include <algorithm>

#include "gs_core/geometry/vectors.h"

namespace gs {
namespace {

constexpr double kOutlierDistance = 10;  // times the distance that nine in ten positions keep
constexpr double kOrdinaryShare = 0.9;

}  // namespace

Vec3d median_position(const std::vector<Vec3d>& positions) {
  Vec3d median(0.0);
  std::vector<double> values(positions.size());
  for (int axis = 0; axis < 3 && !positions.empty(); ++axis) {
    for (std::size_t i = 0; i < positions.size(); ++i) values[i] = positions[i][axis];
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    median[axis] = *middle;
  }
  return median;
}

double ordinary_distance(const Vec3d& center, const std::vector<Vec3d>& positions) {
  if (positions.empty()) return 0;
  std::vector<double> distances;
  for (const Vec3d& position : positions) distances.push_back(length(position - center));
  const auto ordinary =
      distances.begin() + std::ptrdiff_t(kOrdinaryShare * double(distances.size() - 1));
  std::nth_element(distances.begin(), ordinary, distances.end());
  return *ordinary;
}

std::vector<std::size_t> outlier_positions(const std::vector<Vec3d>& positions) {
  const Vec3d center = median_position(positions);
  const double ordinary = ordinary_distance(center, positions);
  std::vector<std::size_t> outliers;
  for (std::size_t i = 0; i < positions.size(); ++i)
    if (ordinary > 0 && length(positions[i] - center) > kOutlierDistance * ordinary)
      outliers.push_back(i);
  return outliers;
}

}  // namespace gs
