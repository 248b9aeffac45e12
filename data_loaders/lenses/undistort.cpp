// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/lenses/undistort.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "data_loaders/lenses/resample.h"
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Vec2d normalized(const PinholeCamera<double>& camera, double x, double y) {
  return {(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy};
}

/// The photo pixel that is seen at pixel (x, y) of `pinhole`; both with centers at + 0.5.
Vec2d photo_pixel(const LensCamera& camera, const PinholeCamera<double>& pinhole, double x,
                  double y) {
  const Vec2d landed = distorted(camera, normalized(pinhole, x, y));
  return {camera.pinhole.fx * landed.x + camera.pinhole.cx,
          camera.pinhole.fy * landed.y + camera.pinhole.cy};
}

/// Of a side with more pixels, every second one is tried, or every third, ...: a file of some bytes
/// may name a camera of a million pixels. No photo of today is as large.
constexpr int kMostTried = 16384;
int step_along(int side) { return 1 + (side - 1) / kMostTried; }

/// The largest rectangle round the principal point that the photo's four borders leave free, as
/// distances from the principal point in pixels of the undistorted photo. A border pixel that no
/// ray in front of the camera reaches is infinitely far.
struct FreeRectangle {
  double left = kInfinity, right = kInfinity, top = kInfinity, bottom = kInfinity;
};

FreeRectangle free_rectangle(const LensCamera& camera) {
  const PinholeCamera<double>& photo = camera.pinhole;
  const auto offset = [&](double x, double y) -> std::optional<Vec2d> {
    const std::optional<Vec2d> ideal = undistorted(camera, normalized(photo, x, y));
    if (!ideal) return std::nullopt;
    return Vec2d(photo.fx * ideal->x, photo.fy * ideal->y);
  };
  FreeRectangle free;
  for (int y = 0; y < photo.height; y += step_along(photo.height)) {
    if (const auto at = offset(0.5, y + 0.5)) free.left = std::min(free.left, -at->x);
    if (const auto at = offset(photo.width - 0.5, y + 0.5))
      free.right = std::min(free.right, at->x);
  }
  for (int x = 0; x < photo.width; x += step_along(photo.width)) {
    if (const auto at = offset(x + 0.5, 0.5)) free.top = std::min(free.top, -at->y);
    if (const auto at = offset(x + 0.5, photo.height - 0.5))
      free.bottom = std::min(free.bottom, at->y);
  }
  return free;
}

/// The pinhole of the photo with its sides scaled: focal lengths kept, principal point moved along.
PinholeCamera<double> cropped(const PinholeCamera<double>& photo, double scale_x, double scale_y) {
  PinholeCamera<double> result = photo;
  result.width = int(std::floor(scale_x * photo.width + 1e-6));
  result.height = int(std::floor(scale_y * photo.height + 1e-6));
  result.cx = photo.cx * result.width / photo.width;
  result.cy = photo.cy * result.height / photo.height;
  return result;
}

/// Whether every pixel of `pinhole` shows one of the photo's: the border is tried, and a
/// grid inside, where only a lens that folds back could go wrong.
bool is_filled(const LensCamera& camera, const PinholeCamera<double>& pinhole) {
  constexpr int kGrid = 32;            // steps along each side; lenses are smooth
  constexpr double kTolerance = 0.01;  // pixels; rounding
  const auto shows_photo = [&](double x, double y) {
    const Vec2d at = photo_pixel(camera, pinhole, x, y);
    return at.x > 0.5 - kTolerance && at.x < camera.pinhole.width - 0.5 + kTolerance &&
           at.y > 0.5 - kTolerance && at.y < camera.pinhole.height - 0.5 + kTolerance &&
           is_unfolded(camera, normalized(pinhole, x, y));
  };
  const double right = pinhole.width - 0.5, bottom = pinhole.height - 0.5;
  for (int j = 0; j <= kGrid; ++j)
    for (int i = 0; i <= kGrid; ++i)
      if (!shows_photo(0.5 + (right - 0.5) * i / kGrid, 0.5 + (bottom - 0.5) * j / kGrid))
        return false;
  for (int x = 0; x < pinhole.width; x += step_along(pinhole.width))
    if (!shows_photo(x + 0.5, 0.5) || !shows_photo(x + 0.5, bottom)) return false;
  for (int y = 0; y < pinhole.height; y += step_along(pinhole.height))
    if (!shows_photo(0.5, y + 0.5) || !shows_photo(right, y + 0.5)) return false;
  return true;
}

/// The angles of a pinhole's borders from its axis, in degrees.
struct FieldOfView {
  double left, right, up, down;
  explicit FieldOfView(const PinholeCamera<double>& pinhole)
      : left(degrees(pinhole.cx / pinhole.fx)),
        right(degrees((pinhole.width - pinhole.cx) / pinhole.fx)),
        up(degrees(pinhole.cy / pinhole.fy)),
        down(degrees((pinhole.height - pinhole.cy) / pinhole.fy)) {}
  double widest() const { return std::max({left, right, up, down}); }
  static double degrees(double tangent) { return std::atan(tangent) * 180 / std::numbers::pi; }
};

/// Refuses a pinhole whose borders lie too far from the axis: there it stretches the photo beyond
/// use.
void check_field_of_view(const LensCamera& camera, const PinholeCamera<double>& pinhole,
                         const std::string& photo) {
  const FieldOfView field(pinhole);
  if (field.widest() < kWidestHalfField) return;
  throw Error(
      fmt::format("cannot undistort photo '{}': its camera ({}) has too wide a field of view for "
                  "one pinhole picture. It would span {:.0f} x {:.0f} degrees, with borders {:.0f} "
                  "degrees from the axis; the limit is {:.0f}. Train through the lens with "
                  "--set dataset.lens=auto. Crop the photos before COLMAP sees them, or {}, with "
                  "--max_scale 1 for a smaller field",
                  photo, camera_model_info(camera.model).name, field.left + field.right,
                  field.up + field.down, field.widest(), kWidestHalfField, kUndistortRemedy));
}

/// The pinhole that undistorted_pinhole() describes, however wide; none if the coefficients leave no
/// picture. The lens is one.
std::optional<PinholeCamera<double>> filled_pinhole(const LensCamera& camera) {
  const PinholeCamera<double>& from = camera.pinhole;
  constexpr double kLeast = 0.05;  // of the photo's side: less is no picture
  if (!(from.cx > 0 && from.cx < from.width && from.cy > 0 && from.cy < from.height))
    return std::nullopt;
  // The outermost pixel centers lie half a pixel inside the border.
  const FreeRectangle free = free_rectangle(camera);
  double scale_x =
      std::min((free.left + 0.5) / from.cx, (free.right + 0.5) / (from.width - from.cx));
  double scale_y =
      std::min((free.top + 0.5) / from.cy, (free.bottom + 0.5) / (from.height - from.cy));
  scale_x = std::min(scale_x, kMostEnlargement);
  scale_y = std::min(scale_y, kMostEnlargement);
  // A polynomial that folds back has no such rectangle at its border: go inwards until there is
  // one.
  constexpr double kSmaller = 0.98;
  for (; scale_x > kLeast && scale_y > kLeast; scale_x *= kSmaller, scale_y *= kSmaller) {
    const PinholeCamera<double> result = cropped(from, scale_x, scale_y);
    if (result.width > 0 && result.height > 0 && is_filled(camera, result)) return result;
  }
  return std::nullopt;
}

/// The share of the photo's pixels that a pinhole shows, too.
double kept_share(const LensCamera& camera, const PinholeCamera<double>& pinhole) {
  constexpr int kSteps = 64;  // along each side
  const PinholeCamera<double>& photo = camera.pinhole;
  int kept = 0;
  for (int j = 0; j < kSteps; ++j)
    for (int i = 0; i < kSteps; ++i) {
      const auto ideal = undistorted(camera, normalized(photo, (i + 0.5) / kSteps * photo.width,
                                                        (j + 0.5) / kSteps * photo.height));
      if (!ideal) continue;
      const double x = pinhole.fx * ideal->x + pinhole.cx, y = pinhole.fy * ideal->y + pinhole.cy;
      kept += x >= 0 && x <= pinhole.width && y >= 0 && y <= pinhole.height;
    }
  return double(kept) / (kSteps * kSteps);
}

/// Where the pixels of the rows from `begin` to `end` of `pinhole` lie in the photo.
PhotoPositions photo_positions(const LensCamera& camera, const PinholeCamera<double>& pinhole,
                               std::size_t begin, std::size_t end) {
  PhotoPositions result(pinhole.width, int(end - begin));
  std::size_t i = 0;
  for (std::size_t y = begin; y < end; ++y)
    for (int x = 0; x < pinhole.width; ++x, ++i) {
      const Vec2d at = photo_pixel(camera, pinhole, x + 0.5, double(y) + 0.5);
      result.x[i] = float(at.x - 0.5);
      result.y[i] = float(at.y - 0.5);
    }
  return result;
}

}  // namespace

PinholeCamera<double> undistorted_pinhole(const LensCamera& camera, const std::string& photo) {
  if (camera.lens == LensCamera::Lens::none) return camera.pinhole;
  if (camera.is_hemisphere())
    throw Error(fmt::format(
        "cannot undistort photo '{}': it is one half of a panorama, which no pinhole picture can "
        "show; train through the lens with --set dataset.lens=auto, or cut the panoramas into "
        "ordinary views",
        photo));
  if (const auto result = filled_pinhole(camera)) {
    check_field_of_view(camera, *result, photo);
    return *result;
  }
  throw Error(fmt::format(
      "cannot undistort photo '{}': the lens coefficients of its camera ({}) leave no picture; run "
      "COLMAP again, or {}",
      photo, camera_model_info(camera.model).name, kUndistortRemedy));
}

bool is_too_wide_for_pinhole(const LensCamera& camera) {
  if (camera.lens == LensCamera::Lens::none) return false;
  if (camera.is_hemisphere()) return true;
  const auto pinhole = filled_pinhole(camera);
  if (!pinhole) return false;
  return FieldOfView(*pinhole).widest() >= kWidestHalfField ||
         (has_angle_chart(camera.lens) && kept_share(camera, *pinhole) < kLeastKept);
}

Image8 undistorted_photo(const Image8& image, const LensCamera& camera,
                         const PinholeCamera<double>& pinhole, const std::string& photo) {
  GS_CHECK(image.width == camera.pinhole.width && image.height == camera.pinhole.height);
  if (std::max({image.width, image.height, pinhole.width, pinhole.height}) > kLongestResampled)
    throw Error(fmt::format("cannot undistort photo '{}': {} takes at most {} pixels a side; {}",
                            photo, resampler_name(), kLongestResampled, kUndistortRemedy));
  Image8 result(pinhole.width, pinhole.height, image.channels);
  constexpr std::size_t kRowsPerChunk = 16;  // the positions of a chunk stay in the cache
  parallel_chunks(
      std::size_t(result.height), kRowsPerChunk, [&](std::size_t begin, std::size_t end) {
        resample(image, photo_positions(camera, pinhole, begin, end), &result.at(0, int(begin), 0));
      });
  return result;
}

}  // namespace gs
