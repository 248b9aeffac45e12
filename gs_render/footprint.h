// SPDX-License-Identifier: Apache-2.0
// Where a Gaussian is in a picture by the rules of other rasterizers, whose scripts read radii to
// tell which Gaussians a picture has. Pictures of ours do not depend on it.
#pragma once

#include "gs_core/math/render/splat.h"

namespace gs {

/// The shape whose half sides are the radii.
enum class FootprintShape {
  square,  // three standard deviations of the longer axis, whatever the opacity (Kerbl et al. 2023)
  box,     // around the ellipse outside of which no fragment is drawn (Ye et al. 2025, gsplat)
};
struct FootprintRule {
  FootprintShape shape = FootprintShape::square;
  float clip = 0;  // pixels; where no radius is above it, a Gaussian is not visible
  int tile = 1;    // pixels; a shape that meets the picture, completed to whole tiles, is visible
};

/// A Gaussian in a view; zeros where it is not visible.
template <class T>
struct Footprint {
  Vec2<T> mean2d{T(0), T(0)};       // pixels
  T depth{0};                       // world units, by depth_of()
  Sym2<T> conic{T(0), T(0), T(0)};  // 1 / pixels^2
  T compensation{0};                // antialias_factor() of its opacity
  int radius_x = 0, radius_y = 0;   // pixels
};

/// The footprint of the ellipsoid at p, in camera coordinates, with a world covariance.
///
/// Not visible: not between the planes, beyond the lens, image covariance singular, under `clip`, or beside the
/// picture.
template <class T>
GS_HD Footprint<T> footprint(const PinholeCamera<T>& camera, const Vec3<T>& p, const Sym3<T>& sigma,
                             const T& opacity, const SplatSettings& settings,
                             const FootprintRule& rule) {
  using std::ceil;
  using std::log;
  using std::sqrt;
  constexpr T kMostRadius(1e9), kMostReach(3.33);  // pixels that fit an int; standard deviations
  const T depth = depth_of(camera, p);
  if (!(depth > T(settings.near_plane) && depth < T(settings.far_plane))) return {};
  if (is_beyond_lens(camera, p, sigma)) return {};
  const T blur = blur_of<T>(settings);
  const ProjectedPoint<T> point = project_point(camera, p);
  const Sym2<T> cov2d = project_covariance(point.A, sigma, blur);
  if (!(determinant(cov2d) > T(0))) return {};
  Footprint<T> found{point.mean2d, depth, conic_of(cov2d), antialias_factor(cov2d, blur)};
  Vec2<T> radii;
  if (rule.shape == FootprintShape::square) {
    const T half = (cov2d.xx - cov2d.yy) / 2;
    const T largest = (cov2d.xx + cov2d.yy) / 2 + sqrt(half * half + cov2d.xy * cov2d.xy);
    radii.x = radii.y = ceil(3 * sqrt(largest));
  } else {
    const T drawn = settings.antialias ? opacity * found.compensation : opacity;
    const T visible = drawn / T(kMinAlpha);
    T reach = visible > T(1) ? sqrt(2 * log(visible)) : T(0);
    if (reach > kMostReach) reach = kMostReach;
    radii.x = ceil(reach * sqrt(cov2d.xx));
    radii.y = ceil(reach * sqrt(cov2d.yy));
  }
  const auto whole = [&](int pixels) { return (pixels + rule.tile - 1) / rule.tile * rule.tile; };
  const auto meets = [](const T& at, const T& radius, int size) {
    return at + radius > T(0) && at - radius < T(size);
  };
  if (!((radii.x > T(rule.clip) || radii.y > T(rule.clip)) &&
        meets(found.mean2d.x, radii.x, whole(camera.width)) &&
        meets(found.mean2d.y, radii.y, whole(camera.height))))
    return {};
  found.radius_x = int(radii.x < kMostRadius ? radii.x : kMostRadius);
  found.radius_y = int(radii.y < kMostRadius ? radii.y : kMostRadius);
  return found;
}

}  // namespace gs
