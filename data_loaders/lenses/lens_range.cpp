// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/lenses/lens_range.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "data_loaders/lenses/undistort.h"
#include "gs_core/error.h"
#include "gs_core/math/constants.h"
#include "gs_core/math/lens/lens_projection.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr double kRadians = std::numbers::pi / 180;

/// Rays from the axis outwards, in one direction of the picture.
class Outward {
 public:
  Outward(const LensCamera& camera, const Vec2d& direction)
      : camera_(camera), direction_(direction), has_angles_(has_angle_chart(camera.lens)) {}

  Vec2d at(double theta) const { return direction_ * (has_angles_ ? theta : std::tan(theta)); }
  /// Whether the lens is unfolded there and moves pixels fast enough.
  bool counts(double theta) const {
    const MapAt<double> map = map_at<double>(camera_, at(theta));
    const double determinant = map.row_x.x * map.row_y.y - map.row_x.y * map.row_y.x;
    const Vec2d moved(inner(map.row_x, direction_), inner(map.row_y, direction_));
    const double cosine = has_angles_ ? 1 : std::cos(theta);
    const double rate = inner(direction_, moved) / (cosine * cosine);  // by the angle
    return determinant > 0 && map.row_x.x + map.row_y.y > 0 &&
           rate >= kSlowestLens * radial_scale<double>(camera_, 0).value;
  }
  /// Whether its pixel is in the picture or a margin of its size.
  bool is_in_picture(double theta, double margin) const {
    const Vec2d landed = map_at<double>(camera_, at(theta)).value;
    const PinholeCamera<double>& photo = camera_.pinhole;
    const auto is_within = [&](double at, int size) {
      return at >= -margin * size && at <= (1 + margin) * size;
    };
    return is_within(photo.fx * landed.x + photo.cx, photo.width) &&
           is_within(photo.fy * landed.y + photo.cy, photo.height);
  }

 private:
  const LensCamera& camera_;
  Vec2d direction_;
  bool has_angles_;
};

constexpr double kStep = 0.25 * kRadians;

/// Between two angles, the last one at which `holds` is true: it is so at `low`, and not at `high`.
template <class Holds>
double last_between(double low, double high, const Holds& holds) {
  for (int halving = 0; halving < 50; ++halving) {
    const double middle = (low + high) / 2;
    (holds(middle) ? low : high) = middle;
  }
  return low;
}

/// The angle up to which the lens counts, at most `most`.
double counts_to(const Outward& ray, double most) {
  const auto counts = [&](double theta) { return ray.counts(theta); };
  for (double low = 0, high = 0;; low = high, high = std::min(high + kStep, most)) {
    if (!counts(high)) return last_between(low, high, counts);
    if (high == most) return most;
  }
}

/// The last angle up to `most` whose pixel is in the picture; the center need not be. 0: there is
/// none.
double seen_to(const Outward& ray, double most, double margin) {
  const auto is_seen = [&](double theta) { return ray.is_in_picture(theta, margin); };
  for (double theta = most; theta > 0; theta -= kStep)
    if (is_seen(theta))
      return theta == most ? most : last_between(theta, std::min(theta + kStep, most), is_seen);
  return 0;
}

/// Directions all around, and those of the picture's sides and corners, which reach farthest.
std::vector<Vec2d> directions(const PinholeCamera<double>& photo) {
  constexpr int kAround = 64;
  std::vector<Vec2d> all;
  for (int i = 0; i < kAround; ++i) {
    const double turn = 2 * std::numbers::pi * i / kAround;
    all.emplace_back(std::cos(turn), std::sin(turn));
  }
  constexpr double m = kFrustumMargin;
  for (const double margin : {0.0, m})
    for (const double x : {-margin, 1 + margin})
      for (const double y : {-margin, 1 + margin}) {
        const Vec2d corner((x * photo.width - photo.cx) / photo.fx,
                           (y * photo.height - photo.cy) / photo.fy);
        if (const double length = std::sqrt(inner(corner, corner)); length > 0)
          all.push_back(corner / length);
      }
  return all;
}

/// The point of the chart that lands at a pixel.
std::optional<Vec2d> seen_at(const LensCamera& camera, double x, double y) {
  const PinholeCamera<double>& photo = camera.pinhole;
  return chart_point(camera, {(x - photo.cx) / photo.fx, (y - photo.cy) / photo.fy});
}

/// The largest angle from the axis in a corner of the picture; `most` where no ray lands.
double angle_of_corners(const LensCamera& camera, double most) {
  double largest = 0;
  for (const int x : {0, camera.pinhole.width})
    for (const int y : {0, camera.pinhole.height}) {
      const std::optional<Vec2d> u = seen_at(camera, x, y);
      if (!u) return most;
      const double r = std::sqrt(inner(*u, *u));
      largest = std::max(largest, has_angle_chart(camera.lens) ? r : std::atan(r));
    }
  return largest;
}

bool explains(const LensCamera& camera, const CameraLens<double>& seen, int x, int y) {
  const std::optional<Vec2d> u = seen_at(camera, x + 0.5, y + 0.5);
  return u && inner(*u, *u) <= seen.radius * seen.radius;
}

}  // namespace

PinholeCamera<double> camera_with_lens(const LensCamera& camera, const std::string& photo) {
  PinholeCamera<double> result = camera.pinhole;
  if (camera.lens == Lens::none) return result;
  const bool has_angles = has_angle_chart(camera.lens);
  const double most = has_angles ? kLargestAngle : kWidestPerspective * kRadians;
  const double margin = has_angles ? 0.0 : double(kFrustumMargin);
  CameraLens<double>& lens = result.lens;
  static_cast<LensCoefficients<double>&>(lens) =
      static_cast<const LensCoefficients<double>&>(camera);
  double end_of_lens = camera.is_hemisphere() ? kHemisphereReach : angle_of_corners(camera, most);
  for (const Vec2d& direction : directions(camera.pinhole)) {
    const Outward ray(camera, direction);
    const double end = counts_to(ray, most);
    const Vec2d u = ray.at(seen_to(ray, end, margin));
    lens.low = {std::min(lens.low.x, u.x), std::min(lens.low.y, u.y)};
    lens.high = {std::max(lens.high.x, u.x), std::max(lens.high.y, u.y)};
    end_of_lens = std::min(end_of_lens, end);
  }
  if (has_angles) lens.low = {-most, -most}, lens.high = {most, most};
  lens.radius = has_angles ? end_of_lens : std::tan(end_of_lens);
  if (!(lens.radius > 1e-3))
    throw Error(fmt::format(
        "cannot train photo '{}' through its lens: the coefficients of its camera ({}) describe no "
        "lens; run COLMAP again, or {}",
        photo, camera_model_info(camera.model).name, kUndistortRemedy));
  return result;
}

PinholeCamera<double> trained_camera(const LensCamera& camera, LensUse use,
                                     const std::string& photo) {
  const bool is_native =
      use == LensUse::native || (use == LensUse::automatic && is_too_wide_for_pinhole(camera));
  return is_native ? camera_with_lens(camera, photo) : undistorted_pinhole(camera, photo);
}

PinholeCamera<double> row_by_row_camera(const LensCamera& camera, LensUse use,
                                        const std::string& photo) {
  const auto refuse = [&](const char* why) {
    throw Error(fmt::format(
        "the camera of photo '{}' moved while its rows were exposed, and {}, or leave the motion "
        "out with --set dataset.rolling_shutter=false",
        photo, why));
  };
  if (camera.is_hemisphere()) refuse("panoramas are cut without it; take cameras with one lens");
  LensCamera with_lens = camera;
  if (camera.lens == Lens::none)
    with_lens.lens = Lens::radial_tangential;
  else if (use == LensUse::undistort)
    refuse("undistorting would mix its rows; train with --set dataset.lens=auto");
  return camera_with_lens(with_lens, photo);
}

bool explains_all_pixels(const LensCamera& camera, const CameraLens<double>& seen) {
  // The pixels that it explains are those up to a radius, so that the border decides.
  const int right = camera.pinhole.width - 1, bottom = camera.pinhole.height - 1;
  for (int x = 0; x <= right; ++x)
    if (!explains(camera, seen, x, 0) || !explains(camera, seen, x, bottom)) return false;
  for (int y = 0; y <= bottom; ++y)
    if (!explains(camera, seen, 0, y) || !explains(camera, seen, right, y)) return false;
  return true;
}

Image8 mask_of_lens(const LensCamera& camera, const CameraLens<double>& seen) {
  Image8 mask(camera.pinhole.width, camera.pinhole.height, 1);
  parallel_for(std::size_t(mask.height), 8, [&](std::size_t y) {
    for (int x = 0; x < mask.width; ++x)
      mask.at(x, int(y), 0) = explains(camera, seen, x, int(y)) ? 255 : 0;
  });
  return mask;
}

}  // namespace gs
