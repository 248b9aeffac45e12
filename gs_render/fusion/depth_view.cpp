// SPDX-License-Identifier: Apache-2.0
#include "gs_render/fusion/depth_view.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "gs_core/geometry/vectors.h"
#include "gs_render/fusion/surface_depth.h"
#include "gs_render/surface_renderer.h"

namespace gs {
namespace {

constexpr float kLeastFacing = 0.25f;  // normals of noisy depth are not better known
constexpr float kSameSurface = 1.05f;  // ratio of the inverse depths of neighbors

}  // namespace

float DepthView::inverse_depth_at(float x, float y) const {
  const int nearest_x = int(x), nearest_y = int(y);
  const float u = x - 0.5f, v = y - 0.5f;
  const int i = int(std::floor(u)), j = int(std::floor(v));
  const float nearest = inverse_depth.at(nearest_x, nearest_y, 0);
  if (i < 0 || j < 0 || i + 1 >= camera.width || j + 1 >= camera.height) return nearest;
  const float a = inverse_depth.at(i, j, 0), b = inverse_depth.at(i + 1, j, 0),
              c = inverse_depth.at(i, j + 1, 0), d = inverse_depth.at(i + 1, j + 1, 0);
  const float least = std::min({a, b, c, d}), most = std::max({a, b, c, d});
  if (!(least > 0) || most > kSameSurface * least) return nearest;
  const float s = u - float(i), t = v - float(j);
  return (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d);
}

DepthView depth_view(const Camera& camera, ImageF inverse_depth, Image8 color) {
  ImageF depth(camera.width, camera.height, 1);
  for (std::size_t i = 0; i < depth.pixels.size(); ++i)
    depth.pixels[i] = inverse_depth.pixels[i] > 0 ? 1 / inverse_depth.pixels[i] : 0;
  const ImageF normals = normals_in_camera(normals_of(depth, camera), camera);
  DepthView view{camera, std::move(inverse_depth), {}, std::move(color)};
  view.facing.resize(depth.pixels.size());
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      if (!(depth.at(x, y, 0) > 0)) continue;
      // Axes of normals_in_camera: right, up, towards the camera.
      const Vec3f ray((float(x) + 0.5f - camera.cx) / camera.fx,
                      -(float(y) + 0.5f - camera.cy) / camera.fy, -1);
      const Vec3f normal(normals.at(x, y, 0), normals.at(x, y, 1), normals.at(x, y, 2));
      const float facing = clamp_to(-inner(normal, unit(ray)), kLeastFacing, 1.0f);
      view.facing[std::size_t(y) * camera.width + x] = std::uint8_t(255 * facing + 0.5f);
    }
  return view;
}

}  // namespace gs
