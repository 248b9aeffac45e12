// SPDX-License-Identifier: Apache-2.0
#include "gs_core/edit/upright.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gs_core/edit/merge_gaussians.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/activations.h"
#include "gs_core/math/rotation.h"

namespace gs {
namespace {

constexpr double kConesInDegrees[] = {45, 30, 20, 12, 8, 8, 8};
constexpr double kLowestShare = 0.02;   // of the Gaussians may lie below the floor
constexpr float kFaintest = 0.1f;       // opacity of a Gaussian that counts for the floor
constexpr float kLeastFlatness = 0.5f;  // the thinnest axis is at most half of the next one

/// A direction and how much it counts.
struct Normal {
  Vec3d direction;
  double weight;
};

std::vector<Normal> normals_of(const Gaussians& gaussians) {
  std::vector<Normal> normals;
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const Quatf& q = gaussians.rotation[i];
    const Vec3f& s = gaussians.log_scale[i];
    if (is_degenerate(q) || !is_finite(s) || !is_finite(gaussians.mean[i])) continue;
    const int thin = s.x <= s.y && s.x <= s.z ? 0 : s.y <= s.z ? 1 : 2;
    const double next = std::min(s[(thin + 1) % 3], s[(thin + 2) % 3]);
    const double flatness = 1 - std::exp(double(s[thin]) - next);
    const double weight = flatness * merge_shape_of(gaussians, i).mass();
    if (flatness < kLeastFlatness || !(weight > 0) || !std::isfinite(weight)) continue;
    const Mat3<double> R = rotation_matrix(Quat<double>{q.w, q.x, q.y, q.z});
    normals.push_back({{R.row0[thin], R.row1[thin], R.row2[thin]}, weight});
  }
  return normals;
}

}  // namespace

Vec3d up_of_surfaces(const Gaussians& gaussians) {
  const std::vector<Normal> normals = normals_of(gaussians);
  Vec3d up(0.0, -1.0, 0.0);
  for (const double degrees : kConesInDegrees) {
    const double least = std::cos(degrees * std::numbers::pi / 180);
    Vec3d sum(0.0);
    for (const auto& [direction, weight] : normals) {
      const double cosine = inner(direction, up);  // a normal has no sign
      if (std::abs(cosine) >= least) sum += (cosine < 0 ? -weight : weight) * direction;
    }
    if (inner(sum, sum) > 0) up = sum / length(sum);
  }
  return up;
}

double floor_height(const Gaussians& gaussians, const Vec3d& up, const Vec3d& center,
                    double radius) {
  std::vector<double> heights;
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const Vec3d from_center = Vec3d(gaussians.mean[i]) - center;
    if (!(inner(from_center, from_center) <= radius * radius)) continue;  // also NaN
    if (sigmoid(gaussians.logit_opacity[i]) >= kFaintest) heights.push_back(inner(from_center, up));
  }
  if (heights.empty()) return 0;
  const auto lowest = heights.begin() + std::ptrdiff_t(kLowestShare * double(heights.size()));
  std::nth_element(heights.begin(), lowest, heights.end());
  return *lowest;
}

}  // namespace gs
