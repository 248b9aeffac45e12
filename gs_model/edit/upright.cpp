// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/upright.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gs_core/geometry/outliers.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/activations.h"
#include "gs_model/edit/select.h"

namespace gs {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kMostTilt = 45 * kDegree, kCoarseStep = 3 * kDegree;
constexpr double kFirstStep = 2 * kDegree, kLastStep = 0.05 * kDegree;
constexpr int kAround = 8;                   // directions around one that are compared with it
constexpr int kHeightSteps = 100;            // of the radius
constexpr std::size_t kMostLooked = 50'000;  // at Gaussians, evenly chosen
constexpr double kMostWeightShare = 0.95;    // heavier Gaussians count as this one in all
constexpr double kLowestShare = 0.02;        // of the Gaussians may lie below the floor
constexpr float kFaintest = 0.1f;            // opacity of a Gaussian that counts

/// What counts for heights: positions relative to their median, and how much each one counts.
struct HeightSamples {
  std::vector<Vec3d> positions;
  std::vector<double> weights;
  double radius = 0;  // none is farther from the median
};

HeightSamples height_samples(const Gaussians& gaussians) {
  const std::vector<float> coverages = coverages_of(gaussians);
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < gaussians.count(); ++i)
    if (is_finite(gaussians.mean[i]) && std::isfinite(coverages[i]) &&
        sigmoid(gaussians.logit_opacity[i]) >= kFaintest)
      rows.push_back(i);
  const std::size_t step = rows.size() / kMostLooked + 1;
  HeightSamples all, near;
  for (std::size_t n = 0; n < rows.size(); n += step) {
    all.positions.push_back(Vec3d(gaussians.mean[rows[n]]));
    all.weights.push_back(coverages[rows[n]]);
  }
  if (all.weights.empty()) return near;
  const Vec3d median = median_position(all.positions);
  near.radius = ordinary_distance(median, all.positions);
  std::vector<double> sorted = all.weights;
  std::sort(sorted.begin(), sorted.end());
  const double most = sorted[std::size_t(kMostWeightShare * double(sorted.size() - 1))];
  for (std::size_t n = 0; n < all.weights.size(); ++n) {
    const Vec3d from_median = all.positions[n] - median;
    if (inner(from_median, from_median) > near.radius * near.radius) continue;
    near.positions.push_back(from_median);
    near.weights.push_back(std::min(all.weights[n], most));
  }
  return near;
}

// The sum of the squared weights of all heights along `up`.
double levelness(const HeightSamples& samples, const Vec3d& up) {
  std::vector<double> counts(2 * kHeightSteps + 2);
  for (std::size_t n = 0; n < samples.positions.size(); ++n) {
    const double height = inner(samples.positions[n], up) / samples.radius;
    counts[std::size_t((height + 1) * kHeightSteps)] += samples.weights[n];
  }
  double sum = 0;
  for (const double count : counts) sum += count * count;
  return sum;
}

// `count` directions at an angle from another one, evenly around it.
std::vector<Vec3d> directions_around(const Vec3d& axis, double angle, int count) {
  const auto [a, b] = axes_across(axis);
  std::vector<Vec3d> directions;
  for (int k = 0; k < count; ++k) {
    const double turn = 2 * std::numbers::pi * k / count;
    const Vec3d aside = std::cos(turn) * a + std::sin(turn) * b;
    directions.push_back(unit(std::cos(angle) * axis + std::sin(angle) * aside));
  }
  return directions;
}

// The direction of the most level one; the first of equal ones.
Vec3d most_level(const HeightSamples& samples, const std::vector<Vec3d>& directions) {
  std::vector<double> scores(directions.size());
  parallel_for(directions.size(), 8,
               [&](std::size_t i) { scores[i] = levelness(samples, directions[i]); });
  return directions[std::size_t(std::max_element(scores.begin(), scores.end()) - scores.begin())];
}

}  // namespace

Vec3d up_of_levels(const Gaussians& gaussians) {
  const HeightSamples samples = height_samples(gaussians);
  const Vec3d start(0.0, -1.0, 0.0);
  if (!(samples.radius > 0)) return start;
  std::vector<Vec3d> directions = {start};
  for (double tilt = kCoarseStep; tilt <= kMostTilt + 1e-9; tilt += kCoarseStep) {
    const int around = int(std::ceil(2 * std::numbers::pi * std::sin(tilt) / kCoarseStep));
    const std::vector<Vec3d> ring = directions_around(start, tilt, around);
    directions.insert(directions.end(), ring.begin(), ring.end());
  }
  Vec3d up = most_level(samples, directions);
  for (double step = kFirstStep; step >= kLastStep;) {
    directions = directions_around(up, step, kAround);
    std::erase_if(directions,
                  [&](const Vec3d& d) { return inner(d, start) < std::cos(kMostTilt); });
    directions.insert(directions.begin(), up);
    const Vec3d better = most_level(samples, directions);
    if (better == up) step /= 2;
    up = better;
  }
  return inner(up, start) > std::cos(kMostTilt - kDegree) ? up : start;
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
