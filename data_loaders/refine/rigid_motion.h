// SPDX-License-Identifier: Apache-2.0
// Motions of rigid bodies, and the similarity between two sets of cameras. In double precision.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/types.h"

namespace gs::rigid {

/// x -> rotation x + translation, of unit length.
struct Motion {
  Quat<double> rotation{1, 0, 0, 0};
  Vec3d translation{0.0, 0.0, 0.0};
};

inline Quat<double> conjugate(const Quat<double>& q) { return {q.w, -q.x, -q.y, -q.z}; }
inline Quat<double> unit(const Quat<double>& q) {
  const double n = 1 / std::sqrt(squared_norm(q));
  return {n * q.w, n * q.x, n * q.y, n * q.z};
}
inline Vec3d rotated(const Quat<double>& q, const Vec3d& v) {
  return multiply(rotation_matrix(q), v);
}
inline Motion product(const Motion& a, const Motion& b) {
  return {unit(product(a.rotation, b.rotation)),
          rotated(a.rotation, b.translation) + a.translation};
}
inline Motion inverse(const Motion& a) {
  const Quat<double> back = conjugate(a.rotation);
  return {back, -rotated(back, a.translation)};
}
inline Vec3d center(const Motion& cam_from_world) { return inverse(cam_from_world).translation; }

/// x_before = scale rotation x_after + translation
struct Similarity {
  double scale = 1;
  Quat<double> rotation{1, 0, 0, 0};
  Vec3d translation{0.0, 0.0, 0.0};

  Vec3d operator()(const Vec3d& x) const { return rotated(rotation, x) * scale + translation; }
};

/// The similarity that brings cameras back best: the mean of their turns; the means of their
/// centers on one another, and the spreads about them.
inline Similarity similarity_of(const std::vector<Motion>& before, const std::vector<Motion>& after,
                                bool keeps_scale) {
  Similarity result;
  Quat<double> sum{0, 0, 0, 0};
  Vec3d mean_before(0.0), mean_after(0.0);
  const double n = 1 / double(before.size());
  for (std::size_t i = 0; i < before.size(); ++i) {
    const Quat<double> turn = product(conjugate(before[i].rotation), after[i].rotation);
    const double sign = turn.w < 0 ? -1 : 1;  // small turns have w near 1
    sum = {sum.w + sign * turn.w, sum.x + sign * turn.x, sum.y + sign * turn.y,
           sum.z + sign * turn.z};
    mean_before += center(before[i]) * n;
    mean_after += center(after[i]) * n;
  }
  if (squared_norm(sum) > 0) result.rotation = unit(sum);
  double spread_before = 0, spread_after = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    const Vec3d a = center(before[i]) - mean_before, b = center(after[i]) - mean_after;
    spread_before += inner(a, a), spread_after += inner(b, b);
  }
  if (!keeps_scale && spread_before > 0 && spread_after > 0)
    result.scale = std::sqrt(spread_before / spread_after);
  result.translation = mean_before - rotated(result.rotation, mean_after) * result.scale;
  return result;
}

/// The same once more without cameras that were far off: they have moved, the scene has not.
inline Similarity robust_similarity_of(const std::vector<Motion>& before,
                                       const std::vector<Motion>& after, bool keeps_scale) {
  constexpr double kFarOff = 3;  // times the median
  const Similarity first = similarity_of(before, after, keeps_scale);
  std::vector<double> moved;
  for (std::size_t i = 0; i < before.size(); ++i)
    moved.push_back(length(first(center(after[i])) - center(before[i])));
  std::vector<double> sorted = moved;
  std::nth_element(sorted.begin(), sorted.begin() + std::ptrdiff_t(sorted.size() / 2),
                   sorted.end());
  const double limit = kFarOff * sorted[sorted.size() / 2];
  std::vector<Motion> kept_before, kept_after;
  for (std::size_t i = 0; i < before.size(); ++i)
    if (moved[i] <= limit) kept_before.push_back(before[i]), kept_after.push_back(after[i]);
  return similarity_of(kept_before, kept_after, keeps_scale);
}

}  // namespace gs::rigid
