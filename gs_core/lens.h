// SPDX-License-Identifier: Apache-2.0
// The lens of a camera: its kind, its coefficients, and how far its formula counts.
#pragma once

#include <limits>
#include <numbers>

#include "gs_core/types.h"

namespace gs {

/// The kinds of lenses. First a chart takes a ray to a point u of the plane, then a map bends it:
///
///   lens                     chart        map                     COLMAP models
///   none                     perspective  none                    (SIMPLE_)PINHOLE
///   radial_tangential        perspective  polynomials             (SIMPLE_)RADIAL, (FULL_)OPENCV
///   fisheye                  angle        polynomials             *_FISHEYE, FISHEYE
///   fisheye_rad_tan          angle        polynomials, chained    RAD_TAN_THIN_PRISM_FISHEYE
///   fov, division, unified   perspective  closed forms            FOV, (SIMPLE_)DIVISION, EUCM
///   orthographic             (x, y)       none                    none; focal lengths are pixels
///                                                                 per world unit
///
/// math/lens/chart.h has the charts, math/lens/lens_map.h the maps.
enum class Lens {
  none,
  radial_tangential,
  fisheye,
  fisheye_rad_tan,
  fov,
  division,
  unified,
  orthographic
};

/// Whether a lens begins with the angle chart, which also takes rays beside and behind the camera.
GS_HD bool has_angle_chart(Lens lens) {
  return lens == Lens::fisheye || lens == Lens::fisheye_rad_tan;
}

/// Whether it begins with (x, y) / z.
GS_HD bool has_perspective_chart(Lens lens) {
  return !has_angle_chart(lens) && lens != Lens::orthographic;
}

/// A lens and its coefficients; those that a model does not have are 0.
template <class T>
struct LensCoefficients {
  using Lens = gs::Lens;
  Lens lens = Lens::none;
  // radial; fov: omega (radians); division: k; unified: alpha, beta
  T k[6] = {T(0), T(0), T(0), T(0), T(0), T(0)};
  T d[3] = {T(0), T(0), T(0)};        // radial, below the line
  T p[2] = {T(0), T(0)};              // tangential
  T s[4] = {T(0), T(0), T(0), T(0)};  // thin prism: two for x, two for y

  bool operator==(const LensCoefficients&) const = default;
};

/// A motion of what is rigid, in its own axes.
template <class T>
struct RigidMotion {
  Vec3<T> turn{T(0), T(0), T(0)};   // axis times angle, radians
  Vec3<T> shift{T(0), T(0), T(0)};  // world units

  GS_HD bool is_any() const { return turn != Vec3<T>(T(0)) || shift != Vec3<T>(T(0)); }
  bool operator==(const RigidMotion&) const = default;
};

/// The lens of a camera that sees through it, with the part of the chart where the lens describes
/// the picture. Beyond, the camera goes on with the lens's tangent at the nearest point inside.
template <class T>
struct CameraLens : LensCoefficients<T> {
  T radius{};                                 // the largest |u|; radians in the angle chart
  Vec2<T> low{T(0), T(0)}, high{T(0), T(0)};  // the range of u in x and y
  // Of the camera while rows are exposed, from those at u'.y = rows.x to those at rows.y; its pose is
  // that between them (math/lens/rolling_shutter.h). Only cameras with a lens have one.
  RigidMotion<T> motion{};
  Vec2<T> rows{T(0), T(0)};

  bool operator==(const CameraLens&) const = default;
};

/// How far the two halves of a panorama see from their axis (data_loaders/lenses/hemispheres.h).
inline constexpr double kHemisphereDegrees = 95;
inline constexpr double kHemisphereReach = kHemisphereDegrees * std::numbers::pi / 180;

/// A lens without coefficients that counts everywhere.
template <class T>
CameraLens<T> endless_lens(Lens kind) {
  constexpr T kEndless = std::numeric_limits<T>::infinity();
  CameraLens<T> lens;
  lens.lens = kind;
  lens.radius = kEndless;
  lens.low = {-kEndless, -kEndless}, lens.high = {kEndless, kEndless};
  return lens;
}

/// The same lens in another scalar.
template <class To, class From>
CameraLens<To> lens_as(const CameraLens<From>& lens) {
  CameraLens<To> result;
  result.lens = lens.lens;
  for (int i = 0; i < 6; ++i) result.k[i] = To(lens.k[i]);
  for (int i = 0; i < 3; ++i) result.d[i] = To(lens.d[i]);
  for (int i = 0; i < 2; ++i) result.p[i] = To(lens.p[i]);
  for (int i = 0; i < 4; ++i) result.s[i] = To(lens.s[i]);
  result.radius = To(lens.radius);
  result.low = {To(lens.low.x), To(lens.low.y)};
  result.high = {To(lens.high.x), To(lens.high.y)};
  result.motion = {Vec3<To>(lens.motion.turn), Vec3<To>(lens.motion.shift)};
  result.rows = {To(lens.rows.x), To(lens.rows.y)};
  return result;
}

}  // namespace gs
