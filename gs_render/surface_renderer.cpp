// SPDX-License-Identifier: Apache-2.0
#include "gs_render/surface_renderer.h"

#include <cmath>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/projection.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kRowsPerChunk = 4096;

/// The points of a depth picture, in the frame of its camera.
class SeenPoints {
 public:
  SeenPoints(const ImageF& depth, const Camera& camera) : depth_(depth), camera_(camera) {
    if (camera.has_lens())
      throw Error(
          "normals are known of pinholes alone, and this camera sees through a lens; --fov DEGREES "
          "makes it a pinhole");
  }

  bool has(int x, int y) const {
    return x >= 0 && y >= 0 && x < depth_.width && y < depth_.height && depth_.at(x, y, 0) > 0;
  }
  Vec3f at(int x, int y) const {
    const float z = depth_.at(x, y, 0);
    return {(float(x) + 0.5f - camera_.cx) / camera_.fx * z,
            (float(y) + 0.5f - camera_.cy) / camera_.fy * z, z};
  }
  /// The difference between the neighbors before and behind a pixel, in steps of (dx, dy). The
  /// pixel itself replaces a neighbor without depth; the difference is 0 if both have none.
  Vec3f difference(int x, int y, int dx, int dy) const {
    const int before = has(x - dx, y - dy), behind = has(x + dx, y + dy);
    return at(x + behind * dx, y + behind * dy) - at(x - before * dx, y - before * dy);
  }

 private:
  const ImageF& depth_;
  const Camera& camera_;
};

}  // namespace

ImageF alpha_of(const RenderPass& pass) {
  ImageF alpha(pass.width, pass.height, 1);
  alpha.pixels = pass.transmittance.download();
  for (float& value : alpha.pixels) value = 1 - value;
  return alpha;
}

SurfaceRenderer::SurfaceRenderer(Renderer& renderer, const GaussiansSpan& gaussians,
                                 const Gaussians& host, const RenderSettings& settings)
    : renderer_(renderer), gaussians_(gaussians), settings_(settings), means_(host.mean.download()),
      sh0_(gaussians.mean.size, renderer.memory()), pass_(renderer.memory()) {
  gaussians_.sh0 = sh0_.span();
  settings_.sh_degree = 0;
  settings_.background = Vec3f(0);
  settings_.use_tensor_cores = false;
  settings_.for_backward = false;
}

ImageF SurfaceRenderer::depth(const Camera& camera) {
  std::vector<Vec3f> values(means_.size());
  const float in_sh0 = 1 / float(kSh0);
  parallel_for(values.size(), kRowsPerChunk, [&](std::size_t i) {
    const float z = max_of(depth_of(camera, to_camera(camera, means_[i])), 0.0f);
    values[i] = (Vec3f(z, 1, 0) - Vec3f(kColorOffset)) * in_sh0;
  });
  sh0_.upload(values);
  renderer_.forward(gaussians_, camera, settings_, pass_);
  const std::vector<float> planes = pass_.image.download();
  ImageF depth(pass_.width, pass_.height, 1);
  const std::size_t plane = pass_.pixel_count();
  for (std::size_t i = 0; i < plane; ++i)
    depth.pixels[i] = planes[plane + i] >= kMinAlpha ? planes[i] / planes[plane + i] : 0;
  return depth;
}

ImageF normals_of(const ImageF& depth, const Camera& camera) {
  ImageF normals(depth.width, depth.height, 3);
  const SeenPoints points(depth, camera);
  parallel_for(std::size_t(depth.height), 1, [&](std::size_t row) {
    const int y = int(row);
    for (int x = 0; x < depth.width; ++x) {
      if (!points.has(x, y)) continue;
      Vec3f n = cross(points.difference(x, y, 0, 1), points.difference(x, y, 1, 0));
      const float length = std::sqrt(inner(n, n));
      if (!(length > 0)) continue;
      const float side = inner(n, points.at(x, y)) > 0 ? -1.0f : 1.0f;
      n = multiply_transposed(camera.cam_from_world_rotation, n * (side / length));
      for (int c = 0; c < 3; ++c) normals.at(x, y, c) = n[c];
    }
  });
  return normals;
}

ImageF normals_in_camera(const ImageF& normals, const Camera& camera) {
  ImageF result = normals;
  for (std::size_t i = 0; i + 2 < result.pixels.size(); i += 3) {
    const Vec3f n = multiply(camera.cam_from_world_rotation,
                             {normals.pixels[i], normals.pixels[i + 1], normals.pixels[i + 2]});
    result.pixels[i] = n.x;
    result.pixels[i + 1] = 0 - n.y;
    result.pixels[i + 2] = 0 - n.z;
  }
  return result;
}

}  // namespace gs
