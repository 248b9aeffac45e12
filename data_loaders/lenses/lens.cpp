// SPDX-License-Identifier: Apache-2.0
// From the pixel of a photo back to its ray, and the checks of a camera's parameters. The formulas
// from the ray to the pixel are in lens_formulas.h.
#include "data_loaders/lenses/lens.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include "gs_core/error.h"

namespace gs {
namespace {

using namespace lens_formulas;

/// The inverse of angle(): a tan(|a|) / |a|; nothing for rays that do not point forwards.
std::optional<Vec2d> ray_at_angle(const Vec2d& a) {
  const double theta = length(a);
  if (!(theta < std::numbers::pi / 2)) return std::nullopt;
  return theta < kTiny ? a : a * (std::tan(theta) / theta);
}

/// The inverses of fov(), division() and unified(); lens_formulas.h has these.
Vec2d fov_inverse(double w, const Vec2d& landed) {
  const double r = length(landed), slope = 2 * std::tan(w / 2);
  return landed * (r < kTiny ? w / slope : std::tan(r * w) / (r * slope));
}
Vec2d division_inverse(double k, const Vec2d& landed) {
  return landed / (1 + k * inner(landed, landed));
}

///   u' (alpha sqrt(1 - (2 alpha - 1) q) + 1 - alpha) / (1 - alpha^2 q), q = beta r'^2  Khomutenko et al. 2016
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

/// The Jacobian of a map of the plane, by central differences. Its error is about 1e-10, and there
/// is one formula less to maintain.
template <class Map>
Jacobian jacobian(const Map& map, const Vec2d& at) {
  const double h = 1e-6 * std::max(1.0, std::max(std::abs(at.x), std::abs(at.y)));
  const Vec2d right = map(at + Vec2d(h, 0)), left = map(at - Vec2d(h, 0));
  const Vec2d down = map(at + Vec2d(0, h)), up = map(at - Vec2d(0, h));
  const double n = 1 / (2 * h);
  return {n * (right.x - left.x), n * (down.x - up.x), n * (right.y - left.y), n * (down.y - up.y)};
}

/// Whether the map is unfolded all the way from the center: else Newton's method has found a place
/// where the polynomial comes back.
template <class Map>
bool is_before_fold(const Map& map, const Vec2d& at) {
  constexpr int kSteps = 8;
  for (int step = 1; step <= kSteps; ++step)
    if (!jacobian(map, at * (double(step) / kSteps)).is_unfolded()) return false;
  return true;
}

/// The point that the map takes to `landed`, by Newton's method.
template <class Map>
std::optional<Vec2d> inverse(const Map& map, const Vec2d& landed) {
  constexpr int kMostSteps = 100;
  constexpr double kTolerance = 1e-10;  // normalized: 1e-6 pixels at a focal length of 10,000
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
  constexpr double kTolerance = 1e-8;  // normalized; another branch is far away
  const bool lands = length(distorted(camera, ideal) - landed) < kTolerance;
  return lands && is_unfolded(camera, ideal) ? std::optional(ideal) : std::nullopt;
}

[[noreturn]] void fail(const ColmapCamera& camera, const std::string& photo,
                       const std::string& what) {
  throw Error(fmt::format("cannot undistort photo '{}': camera {} ({}) {}; {}", photo, camera.id,
                          camera_model_info(camera.model).name, what, kUndistortRemedy));
}

/// Whether the coefficients of the lens make it the ideal pinhole.
bool is_ideal(const LensCamera& camera) {
  const auto all_zero = [](const auto& values) {
    return std::all_of(std::begin(values), std::end(values), [](double x) { return x == 0; });
  };
  using enum Lens;
  switch (camera.lens) {
    case radial_tangential: return all_zero(camera.k) && all_zero(camera.d) && all_zero(camera.p);
    case fov:
    case division:
    case unified: return camera.k[0] == 0;
    case fisheye:
    case fisheye_rad_tan: return false;
    case none:
    case orthographic: break;
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
  std::vector<double> params = camera.params;
  if (result.is_hemisphere()) {
    params[0] = camera.width;
    pinhole.width = pinhole.height = hemisphere_side(camera.width);
  }
  FocalPlane<double> plane;
  unpack<double>(camera.model, params.data(), plane, result);
  pinhole.fx = plane.fx, pinhole.fy = plane.fy, pinhole.cx = plane.cx, pinhole.cy = plane.cy;
  if (!(pinhole.fx > 0 && pinhole.fy > 0))
    fail(camera, photo, "has a focal length that is not positive");
  if (result.lens == Lens::fov && !(std::abs(result.k[0]) < std::numbers::pi))
    fail(camera, photo, "has an omega that is not below 180 degrees");
  if (is_ideal(result)) result.lens = Lens::none;
  return result;
}

int hemisphere_side(int panorama_width) {
  return int(std::ceil(panorama_width * kHemisphereReach / std::numbers::pi));
}

Vec2d distorted(const LensCamera& camera, const Vec2d& ideal) {
  return distorted<double>(camera, ideal);
}

bool is_unfolded(const LensCamera& camera, const Vec2d& ideal) {
  return jacobian([&](const Vec2d& u) { return distorted(camera, u); }, ideal).is_unfolded();
}

std::optional<Vec2d> chart_point(const LensCamera& camera, const Vec2d& landed) {
  const double* k = camera.k;
  switch (camera.lens) {
    case Lens::none:
    case Lens::orthographic: break;
    case Lens::radial_tangential:
    case Lens::fisheye:
    case Lens::fisheye_rad_tan:
      return inverse([&](const Vec2d& u) { return polynomial(camera, u); }, landed);
    case Lens::fov: return on_branch(camera, fov_inverse(k[0], landed), landed);
    case Lens::division: return on_branch(camera, division_inverse(k[0], landed), landed);
    case Lens::unified: return on_branch(camera, unified_inverse(k[0], k[1], landed), landed);
  }
  return landed;
}

std::optional<Vec2d> undistorted(const LensCamera& camera, const Vec2d& landed) {
  const std::optional<Vec2d> u = chart_point(camera, landed);
  return u && has_angle_chart(camera.lens) ? ray_at_angle(*u) : u;
}

}  // namespace gs
