// SPDX-License-Identifier: Apache-2.0
// Stages 1 and 7 of cameras with a lens: the image-plane mean of a point and the change of that
// mean by the world position, both exact. The covariance stays A Sigma A^T, so that everything
// behind it is the same as for pinholes.   docs/method/lenses.md
#pragma once

#include "gs_core/camera.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/lens/chart.h"

namespace gs {

/// A point u of the chart, moved to the nearest place where the lens counts: into the range of
/// CameraLens first, then towards the center.
template <class T>
struct PointInLens {
  Vec2<T> u;       // before
  Vec2<T> inside;  // after
  Vec2<T> moves;   // 1: that coordinate is free; 0: it is a limit of the range
  T shrink;        // of the second move; 1: none
};
template <class T>
GS_HD PointInLens<T> point_in_lens(const CameraLens<T>& lens, const Vec2<T>& u) {
  using std::sqrt;
  PointInLens<T> point;
  point.u = u;
  point.inside = {clamp_to(u.x, lens.low.x, lens.high.x), clamp_to(u.y, lens.low.y, lens.high.y)};
  point.moves = {point.inside.x == u.x ? T(1) : T(0), point.inside.y == u.y ? T(1) : T(0)};
  const T length2 = inner(point.inside, point.inside);
  point.shrink = length2 > lens.radius * lens.radius ? lens.radius / sqrt(length2) : T(1);
  point.inside *= point.shrink;
  return point;
}
/// dL/du by dL/d(inside).
template <class T>
GS_HD Vec2<T> point_in_lens_vjp(const CameraLens<T>& lens, const PointInLens<T>& point,
                                Vec2<T> dL_dinside) {
  if (point.shrink < T(1)) {  // what is radial moves no more
    const Vec2<T> n = point.inside / lens.radius;
    dL_dinside = point.shrink * (dL_dinside - inner(n, dL_dinside) * n);
  }
  return point.moves * dL_dinside;
}

/// The point of the lens's chart that p has.
template <class T>
GS_HD Vec2<T> chart_of(Lens lens, const Vec3<T>& p) {
  if (lens == Lens::orthographic) return {p.x, p.y};
  return has_angle_chart(lens) ? angle_chart(p).u : Vec2<T>(p.x / p.z, p.y / p.z);
}

/// What stages 1 and 7 share of a point in camera coordinates.
template <class T>
struct ThroughLens {
  PointInLens<T> point;
  MapAt<T> map;         // at point.inside
  AngleChart<T> chart;  // undefined for the perspective chart
  Mat23<T> J;           // du/dp: (1/z) (I | -inside) in the perspective chart, (I | 0) of (x, y)
};
template <class T>
GS_HD ThroughLens<T> through_lens(const PinholeCamera<T>& camera, const Vec3<T>& p) {
  ThroughLens<T> through;
  const Lens lens = camera.lens.lens;
  const bool has_angles = has_angle_chart(lens);
  if (has_angles) through.chart = angle_chart(p);
  through.point = point_in_lens(camera.lens, has_angles ? through.chart.u : chart_of(lens, p));
  const Vec2<T>& at = through.point.inside;
  const T per_z = T(1) / p.z;
  if (has_angles)
    through.J = jacobian(through.chart, p);
  else if (has_perspective_chart(lens))
    through.J = {{per_z, T(0), -at.x * per_z}, {T(0), per_z, -at.y * per_z}};
  else
    through.J = {{T(1), T(0), T(0)}, {T(0), T(1), T(0)}};
  through.map = map_at(camera.lens, at);
  return through;
}

/// Where a point is seen, and how that changes.
template <class T>
struct ProjectedPoint {
  Vec2<T> mean2d;  // pixels
  Mat23<T> A;      // by the world position, where the point is inside   pixels / world unit
};
/// The projection of p through the lens of a camera:
///
///   mean2d = F (u' + D (u - inside)) + c,   A = F D J W,   F = diag(fx, fy)
///
/// u' and D are those of the map at `inside`, which is u where the lens counts.
template <class T>
GS_HD ProjectedPoint<T> project_through_lens(const PinholeCamera<T>& camera, const Vec3<T>& p) {
  const ThroughLens<T> through = through_lens(camera, p);
  const MapAt<T>& map = through.map;
  const Mat23<T>& J = through.J;
  const Vec2<T> beyond = through.point.u - through.point.inside;
  const Mat3<T>& W = camera.cam_from_world_rotation;
  return {{camera.fx * (map.value.x + inner(map.row_x, beyond)) + camera.cx,
           camera.fy * (map.value.y + inner(map.row_y, beyond)) + camera.cy},
          {multiply_transposed(W, camera.fx * (map.row_x.x * J.row0 + map.row_x.y * J.row1)),
           multiply_transposed(W, camera.fy * (map.row_y.x * J.row0 + map.row_y.y * J.row1))}};
}
/// dL/dp of project_through_lens(): that of its formulas everywhere, also beyond the lens.
template <class T>
GS_HD Vec3<T> project_through_lens_vjp(const PinholeCamera<T>& camera, const Vec3<T>& p,
                                       const Vec2<T>& dL_dmean2d, const Mat23<T>& dL_dA) {
  const ThroughLens<T> through = through_lens(camera, p);
  const MapAt<T>& map = through.map;
  const Mat23<T>& J = through.J;
  const Vec2<T> beyond = through.point.u - through.point.inside;
  const Mat3<T>& W = camera.cam_from_world_rotation;
  const Vec3<T> G0 = camera.fx * multiply(W, dL_dA.row0), G1 = camera.fy * multiply(W, dL_dA.row1);
  const T gx = camera.fx * dL_dmean2d.x, gy = camera.fy * dL_dmean2d.y;
  // The map: D, and through it the point where it is taken.
  const Vec2<T> dL_dDx = Vec2<T>(inner(G0, J.row0), inner(G0, J.row1)) + gx * beyond;
  const Vec2<T> dL_dDy = Vec2<T>(inner(G1, J.row0), inner(G1, J.row1)) + gy * beyond;
  Vec2<T> dL_dinside = multiply(map.curve_x, dL_dDx) + multiply(map.curve_y, dL_dDy);
  Vec2<T> dL_du = gx * map.row_x + gy * map.row_y;
  // The chart.
  const Mat23<T> dL_dJ{map.row_x.x * G0 + map.row_y.x * G1, map.row_x.y * G0 + map.row_y.y * G1};
  if (has_angle_chart(camera.lens.lens)) {
    dL_du += point_in_lens_vjp(camera.lens, through.point, dL_dinside);
    return dL_du.x * J.row0 + dL_du.y * J.row1 + jacobian_vjp(through.chart, p, dL_dJ);
  }
  if (camera.lens.lens == Lens::orthographic) {
    dL_du += point_in_lens_vjp(camera.lens, through.point, dL_dinside);
    return {dL_du.x, dL_du.y, T(0)};
  }
  const T per_z = T(1) / p.z;
  const Vec2<T> by_z{dL_dJ.row0.z, dL_dJ.row1.z};
  dL_dinside -= per_z * by_z;
  dL_du += point_in_lens_vjp(camera.lens, through.point, dL_dinside);
  const T dL_dper_z = dL_dJ.row0.x + dL_dJ.row1.y - inner(through.point.inside, by_z);
  return per_z * Vec3<T>(dL_du.x, dL_du.y, -inner(through.point.u, dL_du) - per_z * dL_dper_z);
}

// Wide lenses: an angle chart that reaches this far from the axis has depths along rays, because
// beside the camera those along the axis are 0.
inline constexpr double kWideAngle = 1.4835298641951802;  // radians, 85 degrees
inline constexpr double kBeyondLens = 1.15;  // times the radius: Gaussians farther out are culled
inline constexpr double kLargestAngle = 3.0415926535897933;  // radians, pi - 0.1; the same at most

template <class T>
GS_HD bool is_wide(const CameraLens<T>& lens) {
  return has_angle_chart(lens.lens) && lens.radius > T(kWideAngle);
}

/// Whether a camera has a point in sight, however far beside its picture: in front of a pinhole,
/// within the radius of a lens.
template <class T>
GS_HD bool is_in_sight(const PinholeCamera<T>& camera, const Vec3<T>& p) {
  const CameraLens<T>& lens = camera.lens;
  if (!has_angle_chart(lens.lens) && !(p.z > T(0))) return false;
  if (!camera.has_lens()) return true;
  const Vec2<T> u = chart_of(lens.lens, p);
  return inner(u, u) <= lens.radius * lens.radius;
}

/// What near and far planes, the order of Gaussians and depth pictures mean by depth.   world units
template <class T>
GS_HD T depth_of(const PinholeCamera<T>& camera, const Vec3<T>& p) {
  using std::sqrt;
  return is_wide(camera.lens) ? sqrt(inner(p, p)) : p.z;
}
/// Adds dL/dp of depth_of() to a gradient.
template <class T>
GS_HD void add_depth_vjp(const PinholeCamera<T>& camera, const Vec3<T>& p, const T& dL_ddepth,
                         Vec3<T>& dL_dp) {
  using std::sqrt;
  if (is_wide(camera.lens))
    dL_dp += dL_ddepth / sqrt(inner(p, p)) * p;
  else
    dL_dp.z += dL_ddepth;
}

/// Whether a fisheye does not draw the ellipsoid at p, in camera coordinates: its mean lies too far
/// beyond the lens, or, in a wide one, three of its standard deviations reach the ray straight back.
///
/// sigma  world covariance   world units^2
template <class T>
GS_HD bool is_beyond_lens(const PinholeCamera<T>& camera, const Vec3<T>& p, const Sym3<T>& sigma) {
  using std::sqrt;
  const CameraLens<T>& lens = camera.lens;
  if (!has_angle_chart(lens.lens)) return false;
  const T theta = sqrt(inner(angle_chart(p).u, angle_chart(p).u));
  if (!(theta <= min_of(T(kBeyondLens) * lens.radius, T(kLargestAngle)))) return true;
  if (!is_wide(lens)) return false;
  // dtheta/dp = (z x / r, z y / r, -r) / |p|^2
  const T r2 = p.x * p.x + p.y * p.y, r = sqrt(r2), norm2 = r2 + p.z * p.z;
  const T along = r > T(0) ? p.z / r : T(0);
  const Vec3<T> e =
      multiply_transposed(camera.cam_from_world_rotation, Vec3<T>(along * p.x, along * p.y, -r));
  const T left = (T(3.141592653589793) - theta) * norm2;
  return T(9) * inner(e, multiply(sigma, e)) > left * left;
}

}  // namespace gs
