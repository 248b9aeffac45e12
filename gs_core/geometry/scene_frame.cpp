// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geometry/scene_frame.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gs_core/error.h"
#include "gs_core/geometry/outliers.h"
#include "gs_core/geometry/vectors.h"

namespace gs {
namespace {

using Cameras = std::vector<PinholeCamera<double>>;

constexpr std::size_t kPointsLookedAt = 100'000;
constexpr double kDegreesPerRadian = 180 / std::numbers::pi;
// Weights of a prior against all cameras together: it decides only where these leave a direction
// open.
constexpr double kPriorWeight = 1e-2;
constexpr double kBlindPriorWeight = 1e-6;  // of the cameras' own mean position, for want of points

// When up is known. Spread and roll in degrees; a fan of rows of +-25 degrees has this width.
constexpr double kKnownSpread = 30, kKnownRoll = 15, kKnownWidth = 0.06, kLeastAgreement = 0.2;

/// The minimum of a sum of w |M^(1/2) (x - a)|^2 over x.
struct LeastSquares {
  Sym3<double> matrix{0, 0, 0, 0, 0, 0};
  Vec3d right_side{0.0, 0.0, 0.0};

  void add(double weight, const Sym3<double>& M, const Vec3d& a) {
    matrix = {matrix.xx + weight * M.xx, matrix.xy + weight * M.xy, matrix.xz + weight * M.xz,
              matrix.yy + weight * M.yy, matrix.yz + weight * M.yz, matrix.zz + weight * M.zz};
    right_side += weight * multiply(M, a);
  }
  /// A prior keeps the matrix far from singular.
  Vec3d solution() const { return solve(matrix, right_side); }
};

constexpr Sym3<double> kIdentity{1, 0, 0, 1, 0, 1};
// d d^T
Sym3<double> outer(const Vec3d& d) {
  return {d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z};
}
// I - d d^T: what is left of a vector without its part along d
Sym3<double> projector_across(const Vec3d& d) {
  return {1 - d.x * d.x, -d.x * d.y, -d.x * d.z, 1 - d.y * d.y, -d.y * d.z, 1 - d.z * d.z};
}

Vec3d own_up(const PinholeCamera<double>& camera) { return -camera.cam_from_world_rotation.row1; }

Cameras without_outliers(const std::vector<Camera>& cameras) {
  Cameras all;
  std::vector<Vec3d> positions;
  for (const Camera& camera : cameras) {
    all.push_back(camera_as<double>(camera));
    positions.push_back(all.back().position());
  }
  const std::vector<std::size_t> outliers = outlier_positions(positions);
  Cameras kept;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (!std::binary_search(outliers.begin(), outliers.end(), i)) kept.push_back(all[i]);
  return kept;
}

std::vector<Vec3d> some_of(Span<const Vec3f> points) {
  std::vector<Vec3d> some;
  const std::size_t step = points.size / kPointsLookedAt + 1;
  for (std::size_t i = 0; i < points.size; i += step)
    if (is_finite(points[i])) some.push_back(Vec3d(points[i]));
  return some;
}

Vec3d up_of(const Cameras& cameras) {
  const double count = double(cameras.size());
  Vec3d mean(0.0);
  for (const auto& camera : cameras) mean += own_up(camera);
  if (length(mean) < 1e-6 * count) mean = own_up(cameras.front());  // held in all directions
  LeastSquares sum;
  for (const auto& camera : cameras)  // up . row = 0
    sum.add(1, outer(camera.cam_from_world_rotation.row0), Vec3d(0.0));
  sum.add(kPriorWeight * count, kIdentity, unit(mean));
  const Vec3d up = sum.solution();
  return length(up) > 0 ? unit(up) : unit(mean);
}

Vec3d center_of(const Cameras& cameras, const Vec3d& prior, double prior_weight) {
  LeastSquares sum;
  for (const auto& camera : cameras)
    sum.add(1, projector_across(camera.cam_from_world_rotation.row2), camera.position());
  sum.add(prior_weight * double(cameras.size()), kIdentity, prior);
  return sum.solution();
}

Vec3d mean_position(const Cameras& cameras) {
  Vec3d sum(0.0);
  for (const auto& camera : cameras) sum += camera.position();
  return sum / double(cameras.size());
}

/// Whether the rows of the images, which are level where cameras are not rolled, lie in the plane
/// across `up` and fan out in it, and the cameras' own ups are on its side.
bool rows_determine(const Vec3d& up, const Cameras& cameras) {
  const Vec3d x =
      unit(std::abs(up.x) < 0.9 ? cross(up, Vec3d(1, 0, 0)) : cross(up, Vec3d(0, 1, 0)));
  const Vec3d y = cross(up, x);
  double xx = 0, xy = 0, yy = 0, along = 0, agreement = 0;
  for (const auto& camera : cameras) {
    const Vec3d& row = camera.cam_from_world_rotation.row0;
    const double a = inner(row, x), b = inner(row, y), c = inner(row, up);
    xx += a * a, xy += a * b, yy += b * b, along += c * c;
    agreement += inner(own_up(camera), up);
  }
  const double count = double(cameras.size());
  const double width = 0.5 * (xx + yy - std::hypot(xx - yy, 2 * xy)) / count;  // least eigenvalue
  const double roll = std::asin(std::min(std::sqrt(along / count), 1.0)) * kDegreesPerRadian;
  return width > kKnownWidth && roll < kKnownRoll && agreement > kLeastAgreement * count;
}

SceneFrame frame_about(const Vec3d& center, const Cameras& cameras) {
  SceneFrame frame{up_of(cameras), center};
  std::vector<double> distances;
  double heights = 0, turns = 0;
  for (const auto& camera : cameras) {
    const Vec3d from_center = camera.position() - center;
    distances.push_back(length(from_center));
    if (distances.back() > 0)
      heights += std::asin(std::clamp(inner(from_center, frame.up) / distances.back(), -1.0, 1.0));
    turns += std::acos(std::clamp(inner(own_up(camera), frame.up), -1.0, 1.0));
  }
  const auto middle = distances.begin() + std::ptrdiff_t(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  if (*middle > 0 && std::isfinite(*middle)) frame.radius = *middle;
  frame.elevation = heights / double(cameras.size()) * kDegreesPerRadian;
  frame.up_spread = turns / double(cameras.size()) * kDegreesPerRadian;
  frame.up_is_known = frame.up_spread < kKnownSpread || rows_determine(frame.up, cameras);
  return frame;
}

}  // namespace

SceneFrame scene_frame(const std::vector<Camera>& cameras, Span<const Vec3f> points) {
  const std::vector<Vec3d> some = some_of(points);
  const Vec3d middle = median_position(some);
  if (!cameras.empty()) {
    const Cameras kept = without_outliers(cameras);
    const Vec3d center = some.empty() ? center_of(kept, mean_position(kept), kBlindPriorWeight)
                                      : center_of(kept, middle, kPriorWeight);
    return frame_about(center, kept);
  }
  SceneFrame frame;
  frame.center = middle;
  const double reach = ordinary_distance(middle, some);
  if (reach > 0 && std::isfinite(reach)) frame.radius = reach;
  return frame;
}

SceneFrame scene_frame_about(const Vec3d& center, const std::vector<Camera>& cameras) {
  GS_CHECK(!cameras.empty());
  return frame_about(center, without_outliers(cameras));
}

}  // namespace gs
