// SPDX-License-Identifier: Apache-2.0
#include "gs_render/paths/camera_path.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "gs_core/geometry/outliers.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/quaternion.h"

namespace gs {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180;
constexpr double kTurn = 2 * std::numbers::pi;
constexpr double kWidestGap = kTurn / 4;  // between cameras that stand all around
constexpr int kMostRegroupings = 10;

/// Any unit vector perpendicular to v.
Vec3d across(const Vec3d& v) {
  return unit(std::abs(v.x) < 0.5 * length(v) ? cross(v, {1.0, 0.0, 0.0})
                                              : cross(v, {0.0, 1.0, 0.0}));
}

/// Indices of the poses that are not outliers.
std::vector<std::size_t> ordinary(const std::vector<CameraPose>& poses) {
  std::vector<Vec3d> positions;
  for (const CameraPose& pose : poses) positions.push_back(pose.position);
  const std::vector<std::size_t> outliers = outlier_positions(positions);
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < poses.size(); ++i)
    if (!std::binary_search(outliers.begin(), outliers.end(), i)) indices.push_back(i);
  return indices;
}

/// Distances between poses. A rotation counts as turn_length_ world units per radian.
class Nearness {
 public:
  explicit Nearness(const std::vector<CameraPose>& poses) : poses_(poses) {
    Vec3d middle(0.0);
    for (const CameraPose& pose : poses) middle += pose.position / double(poses.size());
    double sum = 0;
    for (const CameraPose& pose : poses) sum += length(pose.position - middle);
    turn_length_ = sum > 0 ? sum / double(poses.size()) : 1;
  }
  double between(std::size_t a, std::size_t b) const {
    return std::hypot(
        length(poses_[a].position - poses_[b].position),
        turn_length_ * angle_between(poses_[a].world_from_cam, poses_[b].world_from_cam));
  }
  std::size_t nearest_of(const std::vector<std::size_t>& to, std::size_t pose) const {
    return *std::min_element(to.begin(), to.end(), [&](std::size_t a, std::size_t b) {
      return between(pose, a) < between(pose, b);
    });
  }

 private:
  const std::vector<CameraPose>& poses_;
  double turn_length_;
};

/// The pose of a group with the smallest sum of distances to the others.
std::size_t middle_of(const std::vector<std::size_t>& group, const Nearness& nearness) {
  std::size_t best = group.front();
  double least = INFINITY;
  for (const std::size_t candidate : group) {
    double sum = 0;
    for (const std::size_t other : group) sum += nearness.between(candidate, other);
    if (sum < least) least = sum, best = candidate;
  }
  return best;
}

/// Farthest-point sampling: each next pose is the one farthest from all taken so far.
std::vector<std::size_t> spread_out(const std::vector<std::size_t>& all, std::size_t count,
                                    const Nearness& nearness) {
  std::vector<std::size_t> taken = {all.front()};
  std::vector<double> distance(all.size(), INFINITY);
  while (taken.size() < count) {
    for (std::size_t i = 0; i < all.size(); ++i)
      distance[i] = std::min(distance[i], nearness.between(all[i], taken.back()));
    const auto farthest = std::max_element(distance.begin(), distance.end());
    if (*farthest <= 0) break;
    taken.push_back(all[std::size_t(farthest - distance.begin())]);
  }
  return taken;
}

}  // namespace

Quat<double> looking_at(const Vec3d& from, const Vec3d& to, const Vec3d& up) {
  const Vec3d z = unit(to - from), level = cross(z, up);
  const Vec3d x = length(level) > 1e-9 * length(up) ? unit(level) : across(z);
  const Vec3d y = cross(z, x);
  return quaternion_of(Mat3<double>{{x.x, y.x, z.x}, {x.y, y.y, z.y}, {x.z, y.z, z.z}});
}

CameraArc arc_of_cameras(const SceneFrame& frame, const std::vector<CameraPose>& poses) {
  const Vec3d e1 = across(frame.up), e2 = cross(frame.up, e1);
  std::vector<double> angles;
  for (const std::size_t i : ordinary(poses)) {
    const Vec3d from_center = poses[i].position - frame.center;
    angles.push_back(std::atan2(inner(from_center, e2), inner(from_center, e1)));
  }
  if (angles.empty()) return {frame.center + e1, kTurn};
  std::sort(angles.begin(), angles.end());
  double gap = angles.front() + kTurn - angles.back(), begin = angles.front();
  for (std::size_t i = 1; i < angles.size(); ++i)
    if (angles[i] - angles[i - 1] > gap) gap = angles[i] - angles[i - 1], begin = angles[i];
  const double width = gap > kWidestGap ? kTurn - gap : kTurn;
  const double middle = begin + 0.5 * (kTurn - gap);
  return {frame.center + frame.radius * (std::cos(middle) * e1 + std::sin(middle) * e2), width};
}

std::vector<CameraPose> orbit(const Orbit& orbit, std::size_t count) {
  const SceneFrame& frame = orbit.frame;
  const Vec3d start = orbit.start - frame.center;
  const Vec3d level = start - inner(start, frame.up) * frame.up;
  const Vec3d e1 = length(level) > 1e-9 * frame.radius ? unit(level) : across(frame.up);
  const Vec3d e2 = cross(frame.up, e1);
  const double elevation = frame.elevation * kRadiansPerDegree;
  const bool is_closed =
      orbit.swing != 0 || (orbit.turns != 0 && orbit.turns == std::round(orbit.turns));
  const double steps = is_closed ? double(count) : double(std::max<std::size_t>(count, 2)) - 1;
  std::vector<CameraPose> poses;
  for (std::size_t i = 0; i < count; ++i) {
    const double way = kTurn * double(i) / steps;
    const double angle = orbit.swing != 0 ? 0.5 * orbit.swing * std::sin(way) : orbit.turns * way;
    const Vec3d outward = std::cos(elevation) * (std::cos(angle) * e1 + std::sin(angle) * e2) +
                          std::sin(elevation) * frame.up;
    const Vec3d position = frame.center + frame.radius * outward;
    poses.push_back({position, looking_at(position, frame.center, frame.up)});
  }
  return poses;
}

std::vector<std::size_t> representative_poses(const std::vector<CameraPose>& poses,
                                              std::size_t count) {
  const std::vector<std::size_t> all = ordinary(poses);
  if (all.empty() || count == 0) return {};
  std::vector<CameraPose> kept;
  for (const std::size_t i : all) kept.push_back(poses[i]);
  const Nearness nearness(kept);
  std::vector<std::size_t> indices(kept.size());
  std::iota(indices.begin(), indices.end(), std::size_t(0));
  std::vector<std::size_t> chosen = spread_out(indices, count, nearness);
  for (int round = 0; round < kMostRegroupings; ++round) {
    std::vector<std::vector<std::size_t>> groups(kept.size());
    for (const std::size_t i : indices) groups[nearness.nearest_of(chosen, i)].push_back(i);
    std::vector<std::size_t> middles;
    for (const std::size_t i : chosen)
      if (!groups[i].empty()) middles.push_back(middle_of(groups[i], nearness));
    if (middles == chosen) break;
    chosen = middles;
  }
  for (std::size_t& i : chosen) i = all[i];
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

std::vector<std::size_t> short_tour(const std::vector<CameraPose>& poses) {
  const std::size_t n = poses.size();
  if (n == 0) return {};
  const Nearness nearness(poses);
  std::vector<std::size_t> tour = {0}, left(n - 1);
  std::iota(left.begin(), left.end(), std::size_t(1));
  while (!left.empty()) {
    tour.push_back(nearness.nearest_of(left, tour.back()));
    std::erase(left, tour.back());
  }
  const auto leg = [&](std::size_t i, std::size_t j) {
    return nearness.between(tour[i], tour[j % n]);
  };
  constexpr double kRounding = 1e-9;  // a smaller relative gain is rounding
  for (bool is_shorter = true; is_shorter;) {
    is_shorter = false;
    for (std::size_t i = 0; i + 2 < n; ++i)
      for (std::size_t j = i + 2; j < n; ++j) {
        const double now = leg(i, i + 1) + leg(j, j + 1), then = leg(i, j) + leg(i + 1, j + 1);
        if (then >= now * (1 - kRounding)) continue;
        std::reverse(tour.begin() + std::ptrdiff_t(i) + 1, tour.begin() + std::ptrdiff_t(j) + 1);
        is_shorter = true;
      }
  }
  return tour;
}

}  // namespace gs
