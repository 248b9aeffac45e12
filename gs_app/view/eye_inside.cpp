// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/eye_inside.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "gs_core/geometry/vectors.h"
#include "gs_model/edit/select.h"

namespace gs {
namespace {

constexpr int kDirections = 16;             // around the up axis
constexpr int kSteps = 64;                  // of distance
constexpr double kStep = 1.0 / 16;          // of the frame's radius
constexpr double kLow = -0.1, kHigh = 0.5;  // sines: heights above the center that the eye sees
constexpr double kEyeHeight = 0.15;         // of the eye's distance from the center
constexpr double kFree = 0.1;               // optical depth of a step through which one can look
constexpr double kOpaque = 1.5;             // optical depth of a wall
constexpr int kLeastFree = 5;               // steps between the middle and a wall
constexpr int kLeastWalls = 12;             // directions
constexpr double kMiddle = 0.6;             // of the way to the wall
constexpr double kLeastContent = 0.05;      // share of the surfaces that lie in the middle
constexpr double kFacing = 0.5;             // mean cosine between a surface and the line of sight

/// What lies in one direction, by distance from the center.
struct Profile {
  std::array<double, kSteps> surface{};  // world units^2
  std::array<double, kSteps> depth{};    // optical depth
};

std::vector<Profile> profiles_of(const Gaussians& gaussians, const SceneFrame& frame) {
  const auto [x, y] = axes_across(frame.up);
  const std::vector<float> surfaces = coverages_of(gaussians);
  const double solid_angle = 2 * std::numbers::pi / kDirections * (kHigh - kLow);
  std::vector<Profile> profiles(kDirections);
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    const Vec3d from_center = Vec3d(gaussians.mean[i]) - frame.center;
    const double distance = length(from_center), height = inner(from_center, frame.up) / distance;
    const double step = distance / (kStep * frame.radius);
    if (!(height >= kLow && height <= kHigh && step < kSteps && std::isfinite(surfaces[i])))
      continue;
    const double turn = std::atan2(inner(from_center, y), inner(from_center, x));
    const double share = turn / (2 * std::numbers::pi) + 0.5;  // 0 to 1
    Profile& profile = profiles[std::size_t(share * kDirections) % kDirections];
    profile.surface[std::size_t(step)] += surfaces[i];
    profile.depth[std::size_t(step)] += kFacing * surfaces[i] / (solid_angle * distance * distance);
  }
  return profiles;
}

/// The step at which a wall begins behind free space; 0 where there is none.
int wall_of(const Profile& profile) {
  double behind = 0;
  int free = 0;
  for (int k = kSteps - 1; k >= 0; --k) {
    free = profile.depth[std::size_t(k)] < kFree && behind >= kOpaque ? free + 1 : 0;
    if (free == kLeastFree) return k + kLeastFree;
    behind += profile.depth[std::size_t(k)];
  }
  return 0;
}

}  // namespace

std::optional<Vec3d> eye_inside(const Gaussians& gaussians, const SceneFrame& frame) {
  double all = 0, middle = 0;
  int walls = 0, farthest = 0, direction = 0;
  const std::vector<Profile> profiles = profiles_of(gaussians, frame);
  for (int d = 0; d < kDirections; ++d) {
    const Profile& profile = profiles[std::size_t(d)];
    const int wall = wall_of(profile);
    if (wall > 0) ++walls;
    for (int k = 0; k < kSteps; ++k) {
      all += profile.surface[std::size_t(k)];
      if (k < kMiddle * wall) middle += profile.surface[std::size_t(k)];
    }
    if (wall > farthest) farthest = wall, direction = d;
  }
  if (walls < kLeastWalls || middle < kLeastContent * all) return std::nullopt;
  const auto [x, y] = axes_across(frame.up);
  const double turn = 2 * std::numbers::pi * ((direction + 0.5) / kDirections - 0.5);
  const Vec3d away = unit(std::cos(turn) * x + std::sin(turn) * y + kEyeHeight * frame.up);
  return frame.center + (farthest - 1) * kStep * frame.radius * away;
}

}  // namespace gs
