// SPDX-License-Identifier: Apache-2.0
// The formulas of COLMAP's camera models. Each agrees with COLMAP's (src/colmap/sensor/models.h).
#include "data_loaders/lens.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numbers>

#include "gs_core/error.h"

namespace gs {
namespace {

constexpr double kTiny = 1e-9;  // normalised: nearer to the axis than this, limits replace ratios

double length(const Vec2d& u) { return std::sqrt(inner(u, u)); }

/// Radial distortion.                                         Brown 1966; the quotient is OpenCV's
///
///   u (1 + k1 r^2 + ... + k6 r^12) / (1 + d1 r^2 + d2 r^4 + d3 r^6),   r = |u|
Vec2d radial(const LensCamera& camera, const Vec2d& u) {
  const double *k = camera.k, *d = camera.d;
  const double r2 = inner(u, u);
  const double above =
      1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * (k[3] + r2 * (k[4] + r2 * k[5])))));
  return u * (above / (1 + r2 * (d[0] + r2 * (d[1] + r2 * d[2]))));
}

/// What lens elements off the axis (p) and tilted ones (s, thin prism) add at u.
///                                        Brown 1966, Weng et al. 1992; p1, p2 in OpenCV's order
///   x: 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4
///   y: p1 (r^2 + 2 y^2) + 2 p2 x y + s3 r^2 + s4 r^4
Vec2d decentring(const LensCamera& camera, const Vec2d& u) {
  const double *p = camera.p, *s = camera.s;
  const double r2 = inner(u, u), xy = u.x * u.y;
  return {2 * p[0] * xy + p[1] * (r2 + 2 * u.x * u.x) + r2 * (s[0] + r2 * s[1]),
          p[0] * (r2 + 2 * u.y * u.y) + 2 * p[1] * xy + r2 * (s[2] + r2 * s[3])};
}

/// The polynomials of a lens. Most models add radial and decentring distortion of the same point;
/// Aria's (Fisheye624: projectaria_tools, camera intrinsic models) chains them.
Vec2d polynomial(const LensCamera& camera, const Vec2d& u) {
  const Vec2d bent = radial(camera, u);
  const bool chained = camera.lens == LensCamera::Lens::fisheye_rad_tan;
  return bent + decentring(camera, chained ? bent : u);
}

/// Equidistant fisheye: as far from the centre as the ray's angle from the axis, in radians.
///                                                                          Kannala & Brandt 2006
///   u atan(r) / r
Vec2d angle(const Vec2d& u) {
  const double r = length(u);
  return r < kTiny ? u : u * (std::atan(r) / r);
}

/// The inverse of angle(): a tan(|a|) / |a|; nothing for rays that do not point forwards.
std::optional<Vec2d> ray_at_angle(const Vec2d& a) {
  const double theta = length(a);
  if (!(theta < std::numbers::pi / 2)) return std::nullopt;
  return theta < kTiny ? a : a * (std::tan(theta) / theta);
}

/// u atan(2 r tan(w / 2)) / (r w)                                        Devernay & Faugeras 2001
///
/// COLMAP takes a series for |w| < 0.01; it is within 1e-4 of this for r < 1.
Vec2d fov(double w, const Vec2d& u) {
  const double r = length(u), slope = 2 * std::tan(w / 2);
  return u * (r < kTiny ? slope / w : std::atan(r * slope) / (r * w));
}
Vec2d fov_inverse(double w, const Vec2d& landed) {
  const double r = length(landed), slope = 2 * std::tan(w / 2);
  return landed * (r < kTiny ? w / slope : std::tan(r * w) / (r * slope));
}

/// The u' of u = u' / (1 + k |u'|^2) that is nearer to the axis                     Fitzgibbon 2001
///
///   u' = 2 u / (1 + sqrt(1 - 4 k r^2))
Vec2d division(double k, const Vec2d& u) {
  return u * (2 / (1 + std::sqrt(1 - 4 * k * inner(u, u))));
}
Vec2d division_inverse(double k, const Vec2d& landed) {
  return landed / (1 + k * inner(landed, landed));
}

/// Enhanced unified model                                                   Khomutenko et al. 2016
///
///   u / (alpha sqrt(beta r^2 + 1) + 1 - alpha)
///   inverse: u' (alpha sqrt(1 - (2 alpha - 1) q) + 1 - alpha) / (1 - alpha^2 q),   q = beta r'^2
Vec2d unified(double alpha, double beta, const Vec2d& u) {
  return u / (alpha * std::sqrt(beta * inner(u, u) + 1) + 1 - alpha);
}
Vec2d unified_inverse(double alpha, double beta, const Vec2d& landed) {
  const double q = beta * inner(landed, landed);
  return landed *
         ((alpha * std::sqrt(1 - (2 * alpha - 1) * q) + 1 - alpha) / (1 - alpha * alpha * q));
}

/// dx'/dx, dx'/dy; dy'/dx, dy'/dy
struct Jacobian {
  double xx, xy, yx, yy;
  double determinant() const { return xx * yy - xy * yx; }
  bool is_unfolded() const { return determinant() > 0 && xx + yy > 0; }
};

/// Of a map of the plane, by central differences: error about 1e-10, and one formula less to keep
/// in step.
template <class Map>
Jacobian jacobian(const Map& map, const Vec2d& at) {
  const double h = 1e-6 * std::max(1.0, std::max(std::abs(at.x), std::abs(at.y)));
  const Vec2d right = map(at + Vec2d(h, 0)), left = map(at - Vec2d(h, 0));
  const Vec2d down = map(at + Vec2d(0, h)), up = map(at - Vec2d(0, h));
  const double n = 1 / (2 * h);
  return {n * (right.x - left.x), n * (down.x - up.x), n * (right.y - left.y), n * (down.y - up.y)};
}

/// Whether the map is unfolded all the way from the centre: else Newton's method has found a place
/// where the polynomial comes back.
template <class Map>
bool is_before_fold(const Map& map, const Vec2d& at) {
  constexpr int kSteps = 8;
  for (int step = 1; step <= kSteps; ++step)
    if (!jacobian(map, at * (double(step) / kSteps)).is_unfolded()) return false;
  return true;
}

/// Where the map goes to `landed`, by Newton's method.
template <class Map>
std::optional<Vec2d> inverse(const Map& map, const Vec2d& landed) {
  constexpr int kMostSteps = 100;
  constexpr double kTolerance = 1e-10;  // normalised: 1e-6 pixels at a focal length of 10,000
  Vec2d at = landed;
  for (int step = 0; step < kMostSteps; ++step) {
    const Vec2d error = map(at) - landed;
    if (length(error) < kTolerance)
      return is_before_fold(map, at) ? std::optional(at) : std::nullopt;
    const Jacobian J = jacobian(map, at);
    const double determinant = J.determinant();
    if (!(std::abs(determinant) > 1e-12)) return std::nullopt;
    at -= Vec2d(J.yy * error.x - J.xy * error.y, J.xx * error.y - J.yx * error.x) / determinant;
  }
  return std::nullopt;
}

/// `ideal`, found in closed form, if it lies on the branch that distorted() takes.
std::optional<Vec2d> on_branch(const LensCamera& camera, const Vec2d& ideal, const Vec2d& landed) {
  constexpr double kTolerance = 1e-8;  // normalised; another branch is far away
  const bool lands = length(distorted(camera, ideal) - landed) < kTolerance;
  return lands && is_unfolded(camera, ideal) ? std::optional(ideal) : std::nullopt;
}

[[noreturn]] void fail(const ColmapCamera& camera, const std::string& photo,
                       const std::string& what, const char* remedy = kUndistortRemedy) {
  throw Error(fmt::format("cannot undistort photo '{}': camera {} ({}) {}; {}", photo, camera.id,
                          camera_model_info(camera.model).name, what, remedy));
}

/// Whether the coefficients of the lens make it the ideal pinhole.
bool is_ideal(const LensCamera& camera) {
  const auto all_zero = [](const auto& values) {
    return std::all_of(std::begin(values), std::end(values), [](double x) { return x == 0; });
  };
  using enum LensCamera::Lens;
  switch (camera.lens) {
    case radial_tangential: return all_zero(camera.k) && all_zero(camera.d) && all_zero(camera.p);
    case fov:
    case division:
    case unified: return camera.k[0] == 0;
    case fisheye:
    case fisheye_rad_tan: return false;
    case none: break;
  }
  return true;
}

}  // namespace

LensCamera lens_camera(const ColmapCamera& camera, const std::string& photo) {
  GS_CHECK(int(camera.params.size()) == camera_model_info(camera.model).param_count);
  LensCamera result;
  result.model = camera.model;
  PinholeCamera<double>& pinhole = result.pinhole;
  pinhole.width = camera.width;
  pinhole.height = camera.height;
  // Models begin with f, cx, cy or with fx, fy, cx, cy; both leave `next` at the coefficients.
  const double* next = camera.params.data();
  const auto one_focal = [&] {
    pinhole.fx = pinhole.fy = next[0], pinhole.cx = next[1], pinhole.cy = next[2], next += 3;
  };
  const auto two_focals = [&] {
    pinhole.fx = next[0], pinhole.fy = next[1], pinhole.cx = next[2], pinhole.cy = next[3];
    next += 4;
  };
  const auto coefficients = [&](LensCamera::Lens lens, std::initializer_list<double*> targets) {
    result.lens = lens;
    for (double* target : targets) *target = *next++;
  };
  double *k = result.k, *d = result.d, *p = result.p, *s = result.s;
  using enum LensCamera::Lens;
  switch (camera.model) {
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
    case CameraModel::fisheye: two_focals(), coefficients(fisheye, {}); break;
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
    case CameraModel::division: two_focals(), coefficients(division, {k}); break;
    case CameraModel::eucm: two_focals(), coefficients(unified, {k, k + 1}); break;
    case CameraModel::equirectangular:
      fail(camera, photo,
           "is a panorama of 360 x 180 degrees, which no single pinhole picture can show",
           "cut the panoramas into perspective views or cube faces and give COLMAP those, for "
           "example with COLMAP's python/examples/panorama_sfm.py");
  }
  if (!(pinhole.fx > 0 && pinhole.fy > 0))
    fail(camera, photo, "has a focal length that is not positive");
  if (result.lens == fov && !(std::abs(result.k[0]) < std::numbers::pi))
    fail(camera, photo, "has an omega that is not below 180 degrees");
  if (is_ideal(result)) result.lens = none;
  return result;
}

Vec2d distorted(const LensCamera& camera, const Vec2d& ideal) {
  const double* k = camera.k;
  switch (camera.lens) {
    case LensCamera::Lens::none: break;
    case LensCamera::Lens::radial_tangential: return polynomial(camera, ideal);
    case LensCamera::Lens::fisheye:
    case LensCamera::Lens::fisheye_rad_tan: return polynomial(camera, angle(ideal));
    case LensCamera::Lens::fov: return fov(k[0], ideal);
    case LensCamera::Lens::division: return division(k[0], ideal);
    case LensCamera::Lens::unified: return unified(k[0], k[1], ideal);
  }
  return ideal;
}

bool is_unfolded(const LensCamera& camera, const Vec2d& ideal) {
  return jacobian([&](const Vec2d& u) { return distorted(camera, u); }, ideal).is_unfolded();
}

std::optional<Vec2d> undistorted(const LensCamera& camera, const Vec2d& landed) {
  const double* k = camera.k;
  const auto before_polynomial = [&] {
    return inverse([&](const Vec2d& u) { return polynomial(camera, u); }, landed);
  };
  switch (camera.lens) {
    case LensCamera::Lens::none: break;
    case LensCamera::Lens::radial_tangential: return before_polynomial();
    case LensCamera::Lens::fisheye:
    case LensCamera::Lens::fisheye_rad_tan: {
      const std::optional<Vec2d> a = before_polynomial();
      return a ? ray_at_angle(*a) : std::nullopt;
    }
    case LensCamera::Lens::fov: return on_branch(camera, fov_inverse(k[0], landed), landed);
    case LensCamera::Lens::division:
      return on_branch(camera, division_inverse(k[0], landed), landed);
    case LensCamera::Lens::unified:
      return on_branch(camera, unified_inverse(k[0], k[1], landed), landed);
  }
  return landed;
}

}  // namespace gs
