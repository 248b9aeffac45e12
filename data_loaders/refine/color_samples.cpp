// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/refine/color_samples.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "data_loaders/photos/photos.h"
#include "gs_core/math/render/projection.h"

namespace gs {
namespace {

// Display sRGB. Sensors and the curves of cameras flatten beyond these.
constexpr float kDarkest = 0.04f, kBrightest = 0.94f;

/// The photo made smaller, and its camera.
struct SmallPhoto {
  Image8 pixels;
  Camera camera;
};

SmallPhoto small_photo(const View& view) {
  const int longer = std::max(view.photo.width, view.photo.height);
  const double scale = std::min(1.0, double(kSampledSide) / longer);
  const auto side = [&](int pixels) { return std::max(1, int(std::lround(pixels * scale))); };
  const int width = side(view.photo.width), height = side(view.photo.height);
  return {area_resized(view.photo, width, height), resized(view.camera, width, height)};
}

/// The color at pixel (x, y), centers at + 0.5; nothing outside the outermost centers.
std::optional<Vec3f> bilinear(const Image8& image, float x, float y) {
  const float u = x - 0.5f, v = y - 0.5f;
  if (!(u >= 0 && v >= 0 && u <= float(image.width - 1) && v <= float(image.height - 1)))
    return std::nullopt;
  const int left = std::min(int(u), std::max(image.width - 2, 0));
  const int top = std::min(int(v), std::max(image.height - 2, 0));
  const int right = std::min(left + 1, image.width - 1),
            below = std::min(top + 1, image.height - 1);
  const float s = u - float(left), t = v - float(top);
  Vec3f color(0);
  for (int c = 0; c < 3; ++c)
    color[c] = ((1 - t) * ((1 - s) * image.at(left, top, c) + s * image.at(right, top, c)) +
                t * ((1 - s) * image.at(left, below, c) + s * image.at(right, below, c))) /
               255;
  return color;
}

bool is_well_exposed(const Vec3f& color) {
  const auto [low, high] = std::minmax({color.x, color.y, color.z});
  return low > kDarkest && high < kBrightest;
}

/// The pixel where a point projects to; nothing if the camera does not have it in sight.
std::optional<Vec2f> pixel_of_point(const Camera& camera, const Vec3f& point) {
  const Vec3f at = to_camera(camera, point);
  if (!is_in_sight(camera, at)) return std::nullopt;
  return pixel_of(camera, at);
}

bool is_masked(const View& view, const Vec3f& point) {
  if (view.mask.empty()) return false;
  const std::optional<Vec2f> at = pixel_of_point(view.camera, point);
  if (!at || !(at->x >= 0 && at->y >= 0 && at->x < float(view.mask.width) &&
               at->y < float(view.mask.height)))
    return true;
  return view.mask.at(int(at->x), int(at->y), 0) < 255;
}

std::optional<Vec3f> color_of(const SmallPhoto& photo, const Vec3f& point) {
  const std::optional<Vec2f> at = pixel_of_point(photo.camera, point);
  return at ? bilinear(photo.pixels, at->x, at->y) : std::nullopt;
}

}  // namespace

std::vector<ColorSample> sample_colors(const View& view, std::uint32_t photo,
                                       const std::vector<ScenePoint>& points,
                                       const std::vector<std::uint32_t>& seen) {
  const SmallPhoto small = small_photo(view);
  std::vector<ColorSample> samples;
  for (const std::uint32_t point : seen) {
    if (is_masked(view, points[point].position)) continue;
    const std::optional<Vec3f> color = color_of(small, points[point].position);
    if (!color || !is_well_exposed(*color)) continue;
    samples.push_back({photo, point, *color});
  }
  return samples;
}

}  // namespace gs
