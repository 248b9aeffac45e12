// SPDX-License-Identifier: Apache-2.0
#include "gs_render/surface_renderer.h"

#include <cmath>

#include "gs_core/math/projection.h"
#include "gs_core/math/rotation.h"
#include "gs_core/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kRowsPerChunk = 4096;

Vec3f column(const Mat3<float>& R, int i) { return {R.row0[i], R.row1[i], R.row2[i]}; }

std::vector<Vec3f> shortest_axes(const Gaussians& gaussians) {
  std::vector<Vec3f> axes(gaussians.count(), Vec3f(0));
  parallel_for(axes.size(), kRowsPerChunk, [&](std::size_t i) {
    const Quatf& q = gaussians.rotation[i];
    if (is_degenerate(q)) return;  // never rendered
    const Vec3f& s = gaussians.log_scale[i];
    axes[i] = column(rotation_matrix(q), s.x <= s.y && s.x <= s.z ? 0 : s.y <= s.z ? 1 : 2);
  });
  return axes;
}

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
      axes_(shortest_axes(host)), sh0_(gaussians.mean.size, renderer.memory()),
      pass_(renderer.memory()) {
  gaussians_.sh0 = sh0_.span();
  settings_.sh_degree = 0;
  settings_.background = Vec3f(0);
  settings_.use_tensor_cores = settings_.half_precision = false;
  settings_.for_backward = false;
}

// `values` are not negative: colours below 0 are blended as 0.
void SurfaceRenderer::blend(const Camera& camera, const std::vector<Vec3f>& values) {
  sh0_.upload(values);
  renderer_.forward(gaussians_, camera, settings_, pass_);
  planes_ = pass_.image.download();
  transmittance_ = pass_.transmittance.download();
}

ImageF SurfaceRenderer::depth(const Camera& camera) {
  std::vector<Vec3f> values(means_.size());
  const float in_sh0 = 1 / float(kSh0);
  parallel_for(values.size(), kRowsPerChunk, [&](std::size_t i) {
    const float z = max_of(to_camera(camera, means_[i]).z, 0.0f);
    values[i] = (Vec3f(z, 1, 0) - Vec3f(kColorOffset)) * in_sh0;
  });
  blend(camera, values);
  ImageF depth(pass_.width, pass_.height, 1);
  const std::size_t plane = pass_.pixel_count();
  for (std::size_t i = 0; i < plane; ++i)
    depth.pixels[i] = planes_[plane + i] >= kMinAlpha ? planes_[i] / planes_[plane + i] : 0;
  return depth;
}

ImageF SurfaceRenderer::normals(const Camera& camera) {
  std::vector<Vec3f> values(means_.size());
  const Vec3f from = camera.position();
  const float in_sh0 = 1 / float(kSh0);
  parallel_for(values.size(), kRowsPerChunk, [&](std::size_t i) {
    const float side = inner(axes_[i], means_[i] - from) > 0 ? -1.0f : 1.0f;
    values[i] = 0.5f * side * axes_[i] * in_sh0;  // the colour 0.5 + 0.5 n
  });
  blend(camera, values);
  ImageF normals(pass_.width, pass_.height, 3);
  const std::size_t plane = pass_.pixel_count();
  for (std::size_t i = 0; i < plane; ++i) {
    const float alpha = 1 - transmittance_[i];
    Vec3f n{2 * planes_[i] - alpha, 2 * planes_[plane + i] - alpha,
            2 * planes_[2 * plane + i] - alpha};
    const float length = std::sqrt(inner(n, n));
    if (!(alpha >= kMinAlpha && length > 0)) continue;
    n /= length;
    for (int c = 0; c < 3; ++c) normals.pixels[3 * i + std::size_t(c)] = n[c];
  }
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
