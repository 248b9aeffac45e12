// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/lens.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_core/error.h"

namespace gs {
namespace {

/// dx'/dx, dx'/dy; dy'/dx, dy'/dy
struct Jacobian {
  double xx, xy, yx, yy;
  double determinant() const { return xx * yy - xy * yx; }
};

/// By central differences: error about 1e-10, and one formula less to keep in step.
Jacobian jacobian(const LensCamera& camera, const Vec2d& ideal) {
  const double h = 1e-6 * std::max(1.0, std::max(std::abs(ideal.x), std::abs(ideal.y)));
  const Vec2d right = distorted(camera, ideal + Vec2d(h, 0)),
              left = distorted(camera, ideal - Vec2d(h, 0));
  const Vec2d down = distorted(camera, ideal + Vec2d(0, h)),
              up = distorted(camera, ideal - Vec2d(0, h));
  const double n = 1 / (2 * h);
  return {n * (right.x - left.x), n * (down.x - up.x), n * (right.y - left.y), n * (down.y - up.y)};
}

Vec2d radial_tangential(const LensCamera& camera, const Vec2d& u) {
  const double* k = camera.k;
  const double p1 = camera.p[0], p2 = camera.p[1];
  const double r2 = inner(u, u);
  const double s =
      (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]))) / (1 + r2 * (k[3] + r2 * (k[4] + r2 * k[5])));
  return {s * u.x + 2 * p1 * u.x * u.y + p2 * (r2 + 2 * u.x * u.x),
          s * u.y + p1 * (r2 + 2 * u.y * u.y) + 2 * p2 * u.x * u.y};
}

Vec2d fisheye(const LensCamera& camera, const Vec2d& u) {
  const double* k = camera.k;
  const double r = std::sqrt(inner(u, u));
  if (r < 1e-9) return u;
  const double theta = std::atan(r), t2 = theta * theta;
  return u * (theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))) / r);
}

/// Whether the lens is unfolded all the way from the centre: else Newton's method has found a place
/// where the polynomial comes back.
bool is_before_fold(const LensCamera& camera, const Vec2d& ideal) {
  constexpr int kSteps = 8;
  for (int step = 1; step <= kSteps; ++step)
    if (!is_unfolded(camera, ideal * (double(step) / kSteps))) return false;
  return true;
}

[[noreturn]] void fail(const ColmapCamera& camera, const std::string& photo,
                       const std::string& what) {
  throw Error(fmt::format("cannot undistort photo '{}': camera {} ({}) {}; {}", photo, camera.id,
                          camera_model_info(camera.model).name, what, kUndistortRemedy));
}

}  // namespace

LensCamera lens_camera(const ColmapCamera& camera, const std::string& photo) {
  const double* p = camera.params.data();
  LensCamera result;
  PinholeCamera<double>& pinhole = result.pinhole;
  pinhole.width = camera.width;
  pinhole.height = camera.height;
  // Models begin with f, cx, cy or with fx, fy, cx, cy; both leave p at the coefficients.
  const auto one_focal = [&] {
    pinhole.fx = pinhole.fy = p[0], pinhole.cx = p[1], pinhole.cy = p[2], p += 3;
  };
  const auto two_focals = [&] {
    pinhole.fx = p[0], pinhole.fy = p[1], pinhole.cx = p[2], pinhole.cy = p[3], p += 4;
  };
  const auto polynomial = [&](LensCamera::Lens lens, int k_count, int p_count = 0) {
    result.lens = lens;
    std::copy_n(p, k_count, result.k), p += k_count;
    std::copy_n(p, p_count, result.p), p += p_count;
  };
  using enum LensCamera::Lens;
  switch (camera.model) {
    case CameraModel::simple_pinhole: one_focal(); break;
    case CameraModel::pinhole: two_focals(); break;
    case CameraModel::simple_radial: one_focal(), polynomial(radial_tangential, 1); break;
    case CameraModel::radial: one_focal(), polynomial(radial_tangential, 2); break;
    case CameraModel::opencv: two_focals(), polynomial(radial_tangential, 2, 2); break;
    case CameraModel::full_opencv:
      two_focals(), polynomial(radial_tangential, 2, 2), std::copy_n(p, 4, result.k + 2);
      break;
    case CameraModel::simple_fisheye: one_focal(), polynomial(fisheye, 0); break;
    case CameraModel::fisheye: two_focals(), polynomial(fisheye, 0); break;
    case CameraModel::simple_radial_fisheye: one_focal(), polynomial(fisheye, 1); break;
    case CameraModel::radial_fisheye: one_focal(), polynomial(fisheye, 2); break;
    case CameraModel::opencv_fisheye: two_focals(), polynomial(fisheye, 4); break;
    default: fail(camera, photo, "has a lens model that gemsplat does not know");
  }
  if (!(pinhole.fx > 0 && pinhole.fy > 0))
    fail(camera, photo, "has a focal length that is not positive");
  const auto is_zero = [](double value) { return value == 0; };
  if (result.lens == radial_tangential && std::all_of(result.k, result.k + 6, is_zero) &&
      std::all_of(result.p, result.p + 2, is_zero))
    result.lens = none;
  return result;
}

Vec2d distorted(const LensCamera& camera, const Vec2d& ideal) {
  switch (camera.lens) {
    case LensCamera::Lens::radial_tangential: return radial_tangential(camera, ideal);
    case LensCamera::Lens::fisheye: return fisheye(camera, ideal);
    default: return ideal;
  }
}

bool is_unfolded(const LensCamera& camera, const Vec2d& ideal) {
  const Jacobian J = jacobian(camera, ideal);
  return J.determinant() > 0 && J.xx + J.yy > 0;
}

std::optional<Vec2d> undistorted(const LensCamera& camera, const Vec2d& landed) {
  constexpr int kMostSteps = 100;
  constexpr double kTolerance = 1e-10;  // normalised: 1e-6 pixels at a focal length of 10,000
  Vec2d ideal = landed;
  for (int step = 0; step < kMostSteps; ++step) {
    const Vec2d error = distorted(camera, ideal) - landed;
    if (inner(error, error) < kTolerance * kTolerance)
      return is_before_fold(camera, ideal) ? std::optional(ideal) : std::nullopt;
    const Jacobian J = jacobian(camera, ideal);
    const double determinant = J.determinant();
    if (!(std::abs(determinant) > 1e-12)) return std::nullopt;
    ideal -= Vec2d(J.yy * error.x - J.xy * error.y, J.xx * error.y - J.yx * error.x) / determinant;
  }
  return std::nullopt;
}

}  // namespace gs
