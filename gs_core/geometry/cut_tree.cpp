// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geometry/cut_tree.h"

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"

namespace gs {
namespace {

constexpr double kTail = 0.05;          // of the points on either side, which may be outliers
constexpr double kNearest = 0.9;        // of the points, which show the axes
constexpr double kParallel = 1 - 1e-9;  // cosine of the angle between the same axis twice

std::vector<double> coordinates(const Vec3d& axis, const std::vector<Vec3d>& points) {
  std::vector<double> result;
  result.reserve(points.size());
  for (const Vec3d& p : points) result.push_back(inner(axis, p));
  return result;
}

// The p-quantile, 0 <= p <= 1; 0 where there are no values. Reorders them.
double quantile(std::vector<double>& values, double p) {
  if (values.empty()) return 0;
  const auto at = values.begin() + std::ptrdiff_t(std::lround(p * double(values.size() - 1)));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Builds the tree of divide() from the root on.
class Divider {
 public:
  explicit Divider(const std::array<Vec3d, 2>& axes) : axes_(axes) {}

  CutTree tree(const std::vector<Vec3d>& points, std::size_t parts) {
    add(points, parts);
    return std::move(tree_);
  }

 private:
  CutSide add(const std::vector<Vec3d>& points, std::size_t parts) {
    if (parts == 1) return {false, next_part_++};
    const std::size_t index = tree_.cuts.size(), below = parts / 2;
    tree_.cuts.push_back(cut(points, double(below) / double(parts)));
    std::vector<Vec3d> side[2];
    for (const Vec3d& p : points) side[tree_.cuts[index].is_below(p) ? 0 : 1].push_back(p);
    const CutSide first = add(side[0], below), second = add(side[1], parts - below);
    tree_.cuts[index].below = first;
    tree_.cuts[index].above = second;
    return {true, index};
  }

  // The cut that leaves this share of the points below it.
  Cut cut(const std::vector<Vec3d>& points, double share) const {
    const bool first_is_longer = reach_along(axes_[0], points) >= reach_along(axes_[1], points);
    Cut result;
    result.normal = axes_[first_is_longer ? 0 : 1];
    if (points.empty()) return result;
    std::vector<double> at = coordinates(result.normal, points);
    std::sort(at.begin(), at.end());
    const auto k = std::clamp<std::size_t>(std::size_t(std::lround(share * double(at.size()))), 1,
                                           std::max<std::size_t>(at.size() - 1, 1));
    result.offset = k < at.size() ? 0.5 * (at[k - 1] + at[k]) : at.back();
    return result;
  }

  const std::array<Vec3d, 2> axes_;
  CutTree tree_;
  std::size_t next_part_ = 0;
};

}  // namespace

std::size_t CutTree::part_of(const Vec3d& p) const {
  if (cuts.empty()) return 0;
  CutSide side{true, 0};
  while (side.is_cut) {
    const Cut& cut = cuts[side.index];
    side = cut.is_below(p) ? cut.below : cut.above;
  }
  return side.index;
}

std::vector<WideHalfSpace> CutTree::bounds_of(std::size_t part) const {
  // The cuts on the way up from the part, and the root at last
  std::vector<WideHalfSpace> bounds;
  CutSide from{false, part};
  const auto is_from = [&](const CutSide& side) {
    return side.is_cut == from.is_cut && side.index == from.index;
  };
  for (bool is_root = cuts.empty(); !is_root;) {
    std::size_t above_it = 0;
    while (!is_from(cuts[above_it].below) && !is_from(cuts[above_it].above)) ++above_it;
    const Cut& cut = cuts[above_it];
    const double sign = is_from(cut.below) ? -1 : 1;
    const WideHalfSpace bound{sign * cut.normal, sign * cut.offset};
    const bool is_outside = std::ranges::any_of(bounds, [&](const WideHalfSpace& inside) {
      return inner(inside.normal, bound.normal) > kParallel && inside.offset >= bound.offset;
    });
    if (!is_outside) bounds.push_back(bound);
    is_root = above_it == 0;
    from = {true, above_it};
  }
  return bounds;
}

bool CutTree::is_whole() const {
  std::vector<int> cut_visits(cuts.size(), 0), part_visits(parts(), 0);
  if (!cuts.empty()) cut_visits[0] = 1;
  for (const Cut& cut : cuts)
    for (const CutSide& side : {cut.below, cut.above}) {
      std::vector<int>& visits = side.is_cut ? cut_visits : part_visits;
      if (side.index >= visits.size()) return false;
      ++visits[side.index];
    }
  // Where each cut but the root is below another one exactly once, a cut that is not reached would
  // be in a circle. Cuts of a file that come before those that lead to them are refused.
  for (std::size_t i = 0; i < cuts.size(); ++i)
    for (const CutSide& side : {cuts[i].below, cuts[i].above})
      if (side.is_cut && side.index <= i) return false;
  const auto is_one = [](int visits) { return visits == 1; };
  return cuts.empty() ||
         (std::ranges::all_of(cut_visits, is_one) && std::ranges::all_of(part_visits, is_one));
}

double reach_along(const Vec3d& axis, const std::vector<Vec3d>& points) {
  std::vector<double> at = coordinates(axis, points);
  const double low = quantile(at, kTail);
  return quantile(at, 1 - kTail) - low;
}

std::array<Vec3d, 2> ground_axes(const Vec3d& up, const std::vector<Vec3d>& points) {
  // Any two axes first: the x axis, or the z axis where x is nearly up
  const Vec3d start = std::abs(up.x) < 0.7 ? Vec3d(1.0, 0.0, 0.0) : Vec3d(0.0, 0.0, 1.0);
  const Vec3d u = unit(start - inner(start, up) * up), v = cross(up, u);
  std::vector<double> x = coordinates(u, points), y = coordinates(v, points);
  std::vector<double> sorted_x = x, sorted_y = y, distances;
  const double middle_x = quantile(sorted_x, 0.5), middle_y = quantile(sorted_y, 0.5);
  for (std::size_t i = 0; i < x.size(); ++i)
    distances.push_back(std::hypot(x[i] -= middle_x, y[i] -= middle_y));
  std::vector<double> sorted = distances;
  const double farthest = quantile(sorted, kNearest);
  double xx = 0, xy = 0, yy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (distances[i] > farthest) continue;
    xx += x[i] * x[i];
    xy += x[i] * y[i];
    yy += y[i] * y[i];
  }
  const double turn = 0.5 * std::atan2(2 * xy, xx - yy);
  const Vec3d first = std::cos(turn) * u + std::sin(turn) * v;
  return {first, cross(up, first)};
}

CutTree divide(const std::vector<Vec3d>& points, const std::array<Vec3d, 2>& axes,
               std::size_t parts) {
  GS_CHECK(parts >= 1);
  return Divider(axes).tree(points, parts);
}

}  // namespace gs
