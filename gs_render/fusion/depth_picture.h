// SPDX-License-Identifier: Apache-2.0
// The depth of a view as every device reads it: one formula for the CPU and the GPU, without fused
// products, so that both have the same bytes.
#pragma once

#include "gs_core/camera.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/projection.h"

namespace gs {

/// What an inverse depth says of a pixel that shows no surface: a positive value is that of one.
inline constexpr float kUnknownDepth = 0;  // Gaussians cover the pixel in part
inline constexpr float kOpenPixel = -1;    // nothing is there

/// A view of arrays that lie where they are read. The point of a pixel is that of its center.
struct DepthPicture {
  Camera camera;
  const float* inverse_depth;  // (height, width)  surface_depth.h
  const std::uint8_t* facing;  // (height, width)  cosine of ray and normal, times 255

  GS_HD std::size_t pixel(int x, int y) const { return std::size_t(y) * camera.width + x; }
  GS_HD bool has(int x, int y) const {
    return x >= 0 && y >= 0 && x < camera.width && y < camera.height &&
           inverse_depth[pixel(x, y)] > 0;
  }
  /// Where a camera point is in the picture, pixels; false where it is not in it.
  GS_HD bool contains(const Vec3f& p, Vec2f& at) const {
    if (!(p.z > 0)) return false;
    at = project_mean(camera, p);
    return at.x >= 0 && at.x < float(camera.width) && at.y >= 0 && at.y < float(camera.height);
  }
  /// The point of a pixel at an inverse depth o > 0, in camera coordinates.
  GS_HD Vec3f point_at(int x, int y, float o) const {
    return {(float(x) + 0.5f - camera.cx) / (camera.fx * o),
            (float(y) + 0.5f - camera.cy) / (camera.fy * o), 1 / o};
  }
  /// The same of a pixel that has a surface, in world coordinates.
  GS_HD Vec3f world_point(int x, int y) const {
    return multiply_transposed(
        camera.cam_from_world_rotation,
        point_at(x, y, inverse_depth[pixel(x, y)]) - camera.cam_from_world_translation);
  }
  /// The inverse depth at a point of the picture, pixels. Between four pixels of one surface it is
  /// bilinear, which is exact on planes; elsewhere it is that of the nearest pixel.
  GS_HD float inverse_depth_at(const Vec2f& at) const {
    using std::floor;
    constexpr float kSameSurface = 1.05f;  // ratio of the inverse depths of neighbors
    const float nearest = inverse_depth[pixel(int(at.x), int(at.y))];
    const float u = at.x - 0.5f, v = at.y - 0.5f;
    const int i = int(floor(u)), j = int(floor(v));
    if (i < 0 || j < 0 || i + 1 >= camera.width || j + 1 >= camera.height) return nearest;
    const float* const upper = inverse_depth + pixel(i, j);
    const float *const lower = upper + camera.width, a = upper[0], b = upper[1], c = lower[0],
                       d = lower[1];
    const float least = min_of(min_of(a, b), min_of(c, d));
    const float most = max_of(max_of(a, b), max_of(c, d));
    if (!(least > 0) || most > kSameSurface * least) return nearest;
    const float s = u - float(i), t = v - float(j);
    return (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d);
  }
  /// The cosine at a pixel, 0 to 1.
  GS_HD float facing_at(int x, int y) const { return float(facing[pixel(x, y)]) / 255.0f; }
  /// The cosine between a pixel's ray and the normal of its neighbors' points, at least 1/4, since
  /// normals of noisy depth are not better known. Only the depth is read.
  GS_HD std::uint8_t facing_of(int x, int y) const {
    using std::abs;
    constexpr float kLeastFacing = 0.25f;
    if (!has(x, y)) return 0;
    const Vec3f n = cross(difference(x, y, 0, 1), difference(x, y, 1, 0));
    const Vec3f p = point_at(x, y, inverse_depth[pixel(x, y)]);
    const float lengths = length(n) * length(p);
    const float facing = lengths > 0 ? abs(inner(n, p)) / lengths : 0.0f;
    return std::uint8_t(255 * clamp_to(facing, kLeastFacing, 1.0f) + 0.5f);
  }

 private:
  /// Between the points of the neighbors before and behind a pixel, in steps of (dx, dy). The pixel
  /// itself replaces a neighbor without depth.
  GS_HD Vec3f difference(int x, int y, int dx, int dy) const {
    const int before = has(x - dx, y - dy), behind = has(x + dx, y + dy);
    const auto point = [this](int px, int py) {
      return point_at(px, py, inverse_depth[pixel(px, py)]);
    };
    return point(x + behind * dx, y + behind * dy) - point(x - before * dx, y - before * dy);
  }
};

}  // namespace gs
