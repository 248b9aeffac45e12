// SPDX-License-Identifier: Apache-2.0
#include "gs_core/outliers.h"

#include <algorithm>
#include <cmath>

namespace gs {
namespace {

constexpr double kStrayDistance = 10;  // times the distance that nine in ten cameras keep
constexpr double kOrdinaryShare = 0.9;

double distance(const Vec3d& a, const Vec3d& b) { return std::sqrt(inner(a - b, a - b)); }

// Component by component, so that a few cameras cannot move it.
Vec3d median_position(const std::vector<Vec3d>& positions) {
  Vec3d median(0.0);
  std::vector<double> values(positions.size());
  for (int axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < positions.size(); ++i) values[i] = positions[i][axis];
    std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
    median[axis] = values[values.size() / 2];
  }
  return median;
}

}  // namespace

std::vector<std::size_t> outlier_positions(const std::vector<Vec3d>& positions) {
  if (positions.empty()) return {};
  const Vec3d center = median_position(positions);
  std::vector<double> distances;
  for (const Vec3d& position : positions) distances.push_back(distance(position, center));
  std::vector<double> sorted = distances;
  std::sort(sorted.begin(), sorted.end());
  const double ordinary = sorted[std::size_t(kOrdinaryShare * double(sorted.size() - 1))];
  std::vector<std::size_t> outliers;
  for (std::size_t i = 0; i < positions.size(); ++i)
    if (ordinary > 0 && distances[i] > kStrayDistance * ordinary) outliers.push_back(i);
  return outliers;
}

}  // namespace gs
