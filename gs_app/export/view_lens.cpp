// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/view_lens.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/lens/lens_projection.h"
#include "gs_render/panorama.h"

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
  const std::array<Camera, 2> cameras = panorama_halves(panorama);
  std::array<std::vector<ImageF>, 2> halves;
  for (const bool is_back : {false, true})
    halves[is_back] = pictures.values(cameras[is_back], quantities);
  std::vector<ImageF> result;
  for (std::size_t q = 0; q < quantities.size(); ++q)
    result.push_back(joined_panorama(panorama, {std::move(halves[0][q]), std::move(halves[1][q])},
                                     quantities[q] != Quantity::depth));
  return result;
}

}  // namespace gs
