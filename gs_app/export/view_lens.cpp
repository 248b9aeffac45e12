// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/view_lens.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "data_loaders/lenses/lens_range.h"
#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/lens/lens_projection.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

using std::numbers::pi;

Camera centered(Camera camera, float focal_length) {
  camera.fx = camera.fy = focal_length;
  camera.cx = 0.5f * float(camera.width);
  camera.cy = 0.5f * float(camera.height);
  camera.lens = {};
  return camera;
}

constexpr double kFiner =
    1.5;  // pixels of a fisheye for one of the panorama, so that it stays sharp

/// A half of a panorama, at its place.
Camera half_of(const Camera& panorama, bool is_back) {
  const int width = int(kFiner * panorama.width), height = width / 2;
  const LensCamera lens = lens_camera(
      {1, CameraModel::equirectangular, width, height, {double(width), double(height)}}, "");
  Camera half = camera_as<float>(camera_with_lens(lens, ""));
  half.cam_from_world_rotation = panorama.cam_from_world_rotation;
  half.cam_from_world_translation = panorama.cam_from_world_translation;
  half.time = panorama.time;
  if (!is_back) return half;
  for (float* axis : {&half.cam_from_world_translation.x, &half.cam_from_world_translation.z})
    *axis = -*axis;
  half.cam_from_world_rotation.row0 = -half.cam_from_world_rotation.row0;
  half.cam_from_world_rotation.row2 = -half.cam_from_world_rotation.row2;
  return half;
}

/// Adds `weight` times the value between pixels to `out`, one number for each channel; of the
/// nearest pixel unless it `is_smooth`.
void add_sample(const ImageF& image, Vec2f at, bool is_smooth, float weight, float* out) {
  at.x = std::clamp(at.x - 0.5f, 0.0f, float(image.width - 1));
  at.y = std::clamp(at.y - 0.5f, 0.0f, float(image.height - 1));
  if (!is_smooth) at = {std::round(at.x), std::round(at.y)};
  const int x = std::min(int(at.x), std::max(image.width - 2, 0));
  const int y = std::min(int(at.y), std::max(image.height - 2, 0));
  const float s = at.x - float(x), t = at.y - float(y);
  const int right = std::min(x + 1, image.width - 1), below = std::min(y + 1, image.height - 1);
  for (int c = 0; c < image.channels; ++c)
    out[c] += weight * ((1 - t) * ((1 - s) * image.at(x, y, c) + s * image.at(right, y, c)) +
                        t * ((1 - s) * image.at(x, below, c) + s * image.at(right, below, c)));
}

}  // namespace

Camera with_fisheye(Camera camera, double degrees) {
  const double focal_length = camera.width / (degrees * pi / 180);
  camera = centered(camera, float(focal_length));
  camera.lens = endless_lens<float>(Lens::fisheye);
  const double corner = 0.5 * std::hypot(camera.width, camera.height) / focal_length;
  if (corner > kLargestAngle)
    throw UsageError(fmt::format(
        "--fov {}: the picture's corners would be {:.0f} degrees from the axis, and a fisheye ends "
        "at {:.0f}; give a smaller angle",
        degrees, corner * 180 / pi, kLargestAngle * 180 / pi));
  camera.lens.radius = float(corner);
  return camera;
}

Camera with_parallel_rays(Camera camera, double width) {
  camera = centered(camera, float(camera.width / width));
  camera.lens = endless_lens<float>(Lens::orthographic);
  return camera;
}

Camera panorama_camera(const Camera& camera, const Vec3d& up, int width) {
  if (width == 0) width = std::min(int(2 * pi * double(camera.fx)), kWidestPanorama) / 4 * 4;
  Camera result = camera;
  result.width = std::max(width, 4), result.height = result.width / 2;
  result = centered(result, float(result.width / (2 * pi)));
  const Mat3<double> W = camera_as<double>(camera).cam_from_world_rotation;
  const auto level = [&](const Vec3d& v) { return v - inner(v, up) * up; };
  Vec3d ahead = level(W.row2);
  // A camera that looks straight up or down has its heading in the picture's columns.
  if (length(ahead) < 1e-3) ahead = level(inner(W.row2, up) * W.row1);
  ahead /= length(ahead);
  const Mat3<double> turned{cross(-up, ahead), -up, ahead};
  result.cam_from_world_rotation = {Vec3f(turned.row0), Vec3f(turned.row1), Vec3f(turned.row2)};
  result.cam_from_world_translation = -multiply(result.cam_from_world_rotation, camera.position());
  return result;
}

std::vector<ImageF> panorama_values(ViewPictures& pictures, const Camera& panorama,
                                    const std::vector<Quantity>& quantities) {
  const Camera cameras[2] = {half_of(panorama, false), half_of(panorama, true)};
  const std::vector<ImageF> halves[2] = {pictures.values(cameras[0], quantities),
                                         pictures.values(cameras[1], quantities)};
  std::vector<ImageF> result;
  for (const ImageF& half : halves[0])
    result.emplace_back(panorama.width, panorama.height, half.channels);
  constexpr double kOverlap = 2 * (kHemisphereReach - pi / 2);
  parallel_for(std::size_t(panorama.height), 4, [&](std::size_t y) {
    const double down = ((double(y) + 0.5) / panorama.height - 0.5) * pi;
    for (int x = 0; x < panorama.width; ++x) {
      const double east = ((x + 0.5) / panorama.width - 0.5) * 2 * pi;
      const Vec3d ray(std::cos(down) * std::sin(east), std::sin(down),
                      std::cos(down) * std::cos(east));
      const double share = std::clamp((kHemisphereReach - std::acos(ray.z)) / kOverlap, 0.0, 1.0);
      for (const bool is_back : {false, true}) {
        const float smooth = float(is_back ? 1 - share : share), nearest = std::round(smooth);
        const float side = is_back ? -1 : 1;
        const Vec3f p(side * float(ray.x), float(ray.y), side * float(ray.z));
        if (smooth == 0) continue;
        const Vec2f at = project_through_lens(cameras[is_back], p).mean2d;
        for (std::size_t q = 0; q < quantities.size(); ++q) {
          const bool is_smooth = quantities[q] != Quantity::depth;
          add_sample(halves[is_back][q], at, is_smooth, is_smooth ? smooth : nearest,
                     &result[q].at(x, int(y), 0));
        }
      }
    }
  });
  return result;
}

}  // namespace gs
