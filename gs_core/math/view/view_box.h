// SPDX-License-Identifier: Apache-2.0
// Boxes around Gaussians, and whether a view can show anything of a box. Neighboring rows share a
// box, so that those outside of a picture need not be read.
#pragma once

#include "gs_core/math/render/ellipsoid.h"

namespace gs {

/// An axis-aligned box in world space; empty where low > high.
struct Box3 {
  Vec3f low, high;  // world units
};
inline constexpr float kInfinity = std::numeric_limits<float>::infinity();
inline constexpr Box3 kEmptyBox = {{kInfinity, kInfinity, kInfinity},
                                   {-kInfinity, -kInfinity, -kInfinity}};

// A Gaussian of opacity 1 ends at sqrt(2 ln 255) = 3.33 standard deviations. The rest is for
// rounding.
inline constexpr float kBoxSigmas = 3.4f;
inline constexpr float kBoxMargin = 3;        // pixels: the image covariance's blur, and rounding
inline constexpr float kBoxRounding = 1e-5f;  // relative to the coordinates of a box

/// True where a Gaussian ends within kBoxSigmas, so that boxes tell what a view can show.
GS_HD bool boxes_hold(const SplatSettings& settings) {
  return settings.truncation != Truncation::sigma4 && settings.bounds != TileBounds::square;
}

/// The box of one Gaussian. Empty where it cannot be drawn because a number is not finite.
GS_HD Box3 box_of(const Ellipsoid& ellipsoid) {
  using std::sqrt;
  const Sym3<float>& s = ellipsoid.sigma;
  const Vec3f half = kBoxSigmas * Vec3f(sqrt(s.xx), sqrt(s.yy), sqrt(s.zz));
  if (!is_finite(ellipsoid.mean) || !is_finite(half)) return kEmptyBox;
  return {ellipsoid.mean - half, ellipsoid.mean + half};
}
/// The box around two boxes.
GS_HD Box3 joined(const Box3& a, const Box3& b) {
  return {{min_of(a.low.x, b.low.x), min_of(a.low.y, b.low.y), min_of(a.low.z, b.low.z)},
          {max_of(a.high.x, b.high.x), max_of(a.high.y, b.high.y), max_of(a.high.z, b.high.z)}};
}

/// The largest value of <v, p> + offset + k z(a) for points p and a of a box, where z is the depth,
/// and a little more than rounding adds.
GS_HD float most_of_box(const Camera& camera, const Box3& box, const Vec3f& v, float offset,
                        float k) {
  using std::fabs;
  const Vec3f center = 0.5f * (box.low + box.high), half = 0.5f * (box.high - box.low);
  const auto absolute = [](const Vec3f& a) { return Vec3f(fabs(a.x), fabs(a.y), fabs(a.z)); };
  const Vec3f& axis = camera.cam_from_world_rotation.row2;
  const float t = camera.cam_from_world_translation.z;
  const float middle = inner(v, center) + offset + k * (inner(axis, center) + t);
  const Vec3f reach = absolute(v) + fabs(k) * absolute(axis);
  const float size = inner(reach, absolute(center) + half) + fabs(offset) + fabs(k * t);
  return middle + inner(reach, half) + kBoxRounding * size;
}

/// Tests whether a view can show something of a box; each is below 0 where its own bound says no.
///
///   0..7   bits 0: axis, x or y;  1: side of the picture, its begin or its end;  2: one of two
///          slopes; nothing can be seen beyond a side if both slopes say no
///   8, 9   nothing is behind the near plane, before the far plane
///
/// For the side x = 0: with X(p) the x of a point in the camera's frame and s the slope at which
/// projection_jacobian() takes a mean a, a splat ends at no more than
///
///   (fx / z(a)) max_p [X(p) - s (z(p) - z(a))] + cx + margin
///
/// where p is a point of the ellipsoid, because that is how the image covariance widens. Beyond the
/// side, s lies between the limit of frustum_limits() and the side itself. In s the bound is
/// linear, so that its two ends are enough.
inline constexpr int kBoxTests = 10;
GS_HD float box_test(const Camera& camera, const SplatSettings& settings, const Box3& box, int k) {
  const Mat3<float>& W = camera.cam_from_world_rotation;
  const Vec3f& t = camera.cam_from_world_translation;
  if (k == 8) return most_of_box(camera, box, W.row2, t.z - settings.near_plane, 0);
  if (k == 9) return most_of_box(camera, box, -W.row2, settings.far_plane - t.z, 0);
  const bool is_y = k & 1, is_end = k & 2, is_second = k & 4;
  const Vec3f& row = is_y ? W.row1 : W.row0;
  const float shift = is_y ? t.y : t.x;
  const float focal = is_y ? camera.fy : camera.fx, center = is_y ? camera.cy : camera.cx;
  const float pixels = float(is_y ? camera.height : camera.width);
  // The grid of tiles may end a tile behind the picture.
  const float end = pixels + float(kWideTile);
  const float side = (is_end ? end - center : -center) / focal;
  const float limit =
      (is_end ? (1 + kFrustumMargin) * pixels - center : -kFrustumMargin * pixels - center) / focal;
  const float slope = !is_second ? limit : is_end ? min_of(side, limit) : side;
  const float sign = is_end ? -1.0f : 1.0f;
  return most_of_box(camera, box, sign * (row - slope * W.row2), sign * (shift - slope * t.z),
                     sign * (slope - side) + kBoxMargin / focal);
}

/// What the tests say together: bit k of `below` is set where test k is below 0.
GS_HD bool is_box_outside(std::uint32_t below) {
  return (below & (below >> 4) & 0xf) != 0 || (below >> 8 & 3) != 0;
}
/// True where the view shows nothing of the Gaussians in a box.
inline bool is_box_outside(const Camera& camera, const SplatSettings& settings, const Box3& box) {
  if (!boxes_hold(settings)) return false;
  std::uint32_t below = 0;
  for (int k = 0; k < kBoxTests; ++k)
    below |= std::uint32_t(box_test(camera, settings, box, k) < 0) << k;
  return is_box_outside(below);
}

}  // namespace gs
