// SPDX-License-Identifier: Apache-2.0
// The formulas of COLMAP's camera models, on any scalar: double undistorts photos, ceres::Jet
// refines cameras. Each agrees with COLMAP's (src/colmap/sensor/models.h).
#pragma once

#include <cmath>
#include <initializer_list>
#include <numbers>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/error.h"
#include "gs_core/lens.h"
#include "gs_core/types.h"

namespace gs {

/// Focal lengths and principal point, pixels.
template <class T>
struct FocalPlane {
  T fx{}, fy{}, cx{}, cy{};
};

/// Sorts the parameters of a model, in COLMAP's order, into the coefficients of the formulas. Those
/// of EQUIRECTANGULAR, the panorama's sides, become the equidistant lens of one of its halves, as
/// sharp as the panorama.
template <class T>
void unpack(CameraModel model, const T* params, FocalPlane<T>& plane, LensCoefficients<T>& result) {
  // Models begin with f, cx, cy or with fx, fy, cx, cy; both leave `next` at the coefficients.
  const T* next = params;
  const auto one_focal = [&] {
    plane.fx = plane.fy = next[0], plane.cx = next[1], plane.cy = next[2], next += 3;
  };
  const auto two_focals = [&] {
    plane.fx = next[0], plane.fy = next[1], plane.cx = next[2], plane.cy = next[3];
    next += 4;
  };
  const auto coefficients = [&](Lens lens, std::initializer_list<T*> targets) {
    result.lens = lens;
    for (T* target : targets) *target = *next++;
  };
  T *k = result.k, *d = result.d, *p = result.p, *s = result.s;
  using enum Lens;
  switch (model) {
    case CameraModel::simple_pinhole: one_focal(); break;
    case CameraModel::pinhole: two_focals(); break;
    case CameraModel::simple_radial: one_focal(), coefficients(radial_tangential, {k}); break;
    case CameraModel::radial: one_focal(), coefficients(radial_tangential, {k, k + 1}); break;
    case CameraModel::opencv:
      two_focals(), coefficients(radial_tangential, {k, k + 1, p, p + 1});
      break;
    case CameraModel::full_opencv:
      two_focals(), coefficients(radial_tangential, {k, k + 1, p, p + 1, k + 2, d, d + 1, d + 2});
      break;
    case CameraModel::simple_fisheye: one_focal(), coefficients(fisheye, {}); break;
    case CameraModel::fisheye: two_focals(), coefficients(Lens::fisheye, {}); break;
    case CameraModel::simple_radial_fisheye: one_focal(), coefficients(fisheye, {k}); break;
    case CameraModel::radial_fisheye: one_focal(), coefficients(fisheye, {k, k + 1}); break;
    case CameraModel::opencv_fisheye:
      two_focals(), coefficients(fisheye, {k, k + 1, k + 2, k + 3});
      break;
    case CameraModel::thin_prism_fisheye:
      two_focals(), coefficients(fisheye, {k, k + 1, p, p + 1, k + 2, k + 3, s, s + 2});
      break;
    case CameraModel::rad_tan_thin_prism_fisheye:  // its p0 is OpenCV's p2
      two_focals(), coefficients(fisheye_rad_tan, {k, k + 1, k + 2, k + 3, k + 4, k + 5, p + 1, p,
                                                   s, s + 1, s + 2, s + 3});
      break;
    case CameraModel::fov: two_focals(), coefficients(fov, {k}); break;
    case CameraModel::simple_division: one_focal(), coefficients(division, {k}); break;
    case CameraModel::division: two_focals(), coefficients(Lens::division, {k}); break;
    case CameraModel::eucm: two_focals(), coefficients(unified, {k, k + 1}); break;
    case CameraModel::equirectangular:
      plane.fx = plane.fy = next[0] / T(2 * std::numbers::pi);
      plane.cx = plane.cy = T(kHemisphereReach) * plane.fx;
      coefficients(fisheye, {});
      break;
  }
}

namespace lens_formulas {

inline constexpr double kTiny = 1e-9;  // normalized; limits replace ratios nearer to the axis

template <class T>
T length(const Vec2<T>& u) {
  using std::sqrt;
  return sqrt(inner(u, u));
}
template <class T>
bool is_on_axis(const Vec2<T>& u) {
  return inner(u, u) < kTiny * kTiny;
}

/// Radial distortion.                                         Brown 1966; the quotient is OpenCV's
///
///   u (1 + k1 r^2 + ... + k6 r^12) / (1 + d1 r^2 + d2 r^4 + d3 r^6),   r = |u|
template <class T>
Vec2<T> radial(const LensCoefficients<T>& lens, const Vec2<T>& u) {
  const T *k = lens.k, *d = lens.d;
  const T r2 = inner(u, u);
  const T above =
      T(1) + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * (k[3] + r2 * (k[4] + r2 * k[5])))));
  return u * (above / (T(1) + r2 * (d[0] + r2 * (d[1] + r2 * d[2]))));
}

/// What lens elements off the axis (p) and tilted ones (s, thin prism) add at u.
///                                        Brown 1966, Weng et al. 1992; p1, p2 in OpenCV's order
///   x: 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4
///   y: p1 (r^2 + 2 y^2) + 2 p2 x y + s3 r^2 + s4 r^4
template <class T>
Vec2<T> decentering(const LensCoefficients<T>& lens, const Vec2<T>& u) {
  const T *p = lens.p, *s = lens.s;
  const T r2 = inner(u, u), xy = u.x * u.y;
  return {T(2) * p[0] * xy + p[1] * (r2 + T(2) * u.x * u.x) + r2 * (s[0] + r2 * s[1]),
          p[0] * (r2 + T(2) * u.y * u.y) + T(2) * p[1] * xy + r2 * (s[2] + r2 * s[3])};
}

/// The polynomials of a lens. Most models add radial and decentering distortion of the same point;
/// Aria's (Fisheye624: projectaria_tools, camera intrinsic models) chains them.
template <class T>
Vec2<T> polynomial(const LensCoefficients<T>& lens, const Vec2<T>& u) {
  const Vec2<T> bent = radial(lens, u);
  const bool chained = lens.lens == Lens::fisheye_rad_tan;
  return bent + decentering(lens, chained ? bent : u);
}

/// Equidistant fisheye: as far from the center as the ray's angle from the axis, in radians.
///                                                                          Kannala & Brandt 2006
///   u atan(r) / r
template <class T>
Vec2<T> angle(const Vec2<T>& u) {
  using std::atan;
  if (is_on_axis(u)) return u;
  const T r = length(u);
  return u * (atan(r) / r);
}

/// u atan(2 r tan(w / 2)) / (r w)                                        Devernay & Faugeras 2001
///
/// COLMAP takes a series for |w| < 0.01; it is within 1e-4 of this for r < 1.
template <class T>
Vec2<T> fov(const T& w, const Vec2<T>& u) {
  using std::atan, std::tan;
  const T slope = T(2) * tan(w / T(2));
  if (is_on_axis(u)) return u * (slope / w);
  const T r = length(u);
  return u * (atan(r * slope) / (r * w));
}

/// The u' of u = u' / (1 + k |u'|^2) that is nearer to the axis                     Fitzgibbon 2001
///
///   u' = 2 u / (1 + sqrt(1 - 4 k r^2))
template <class T>
Vec2<T> division(const T& k, const Vec2<T>& u) {
  using std::sqrt;
  return u * (T(2) / (T(1) + sqrt(T(1) - T(4) * k * inner(u, u))));
}

/// Enhanced unified model                                                   Khomutenko et al. 2016
///
///   u / (alpha sqrt(beta r^2 + 1) + 1 - alpha)
template <class T>
Vec2<T> unified(const T& alpha, const T& beta, const Vec2<T>& u) {
  using std::sqrt;
  return u / (alpha * sqrt(beta * inner(u, u) + T(1)) + T(1) - alpha);
}

}  // namespace lens_formulas

/// The normalized point where the ray through `ideal` meets the photo; not a number if the model
/// has no answer.
template <class T>
Vec2<T> distorted(const LensCoefficients<T>& lens, const Vec2<T>& ideal) {
  using namespace lens_formulas;
  const T* k = lens.k;
  switch (lens.lens) {
    case Lens::none:
    case Lens::orthographic: break;  // of no camera model
    case Lens::radial_tangential: return polynomial(lens, ideal);
    case Lens::fisheye:
    case Lens::fisheye_rad_tan: return polynomial(lens, angle(ideal));
    case Lens::fov: return fov(k[0], ideal);
    case Lens::division: return division(k[0], ideal);
    case Lens::unified: return unified(k[0], k[1], ideal);
  }
  return ideal;
}

}  // namespace gs
