// SPDX-License-Identifier: Apache-2.0
// Stage 7 for runs that refine poses: each visible Gaussian pulls the gradient of its splat back to
// the camera, and all of these are added up.
#include <algorithm>
#include <vector>

#include "gs_core/math/camera_gradient.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"

namespace gs {
namespace {

constexpr std::size_t kRowsPerSum =
    512;  // a sum of its own, so that threads do not change the bits

void add_to(CameraGradient<double>& sum, const CameraGradient<float>& part) {
  sum.turn += Vec3d(part.turn);
  sum.center += Vec3d(part.center);
}

}  // namespace

CameraGradient<double> camera_gradient(const GaussiansSpan& gaussians, const Camera& camera,
                                       const RenderSettings& settings, const RenderPass& pass) {
  const HostStage stage("camera gradient");
  const std::size_t count = gaussians.mean.size;
  std::vector<CameraGradient<double>> sums((count + kRowsPerSum - 1) / kRowsPerSum,
                                           {Vec3d(0.0), Vec3d(0.0)});
  parallel_for(sums.size(), 1, [&](std::size_t k) {
    const std::size_t end = std::min(count, (k + 1) * kRowsPerSum);
    for (std::size_t i = k * kRowsPerSum; i < end; ++i)
      if (pass.tile_counts[i])
        add_to(sums[k], camera_vjp(gaussians, i, camera, settings, splat_gradient_of(pass, i)));
  });
  CameraGradient<double> all{Vec3d(0.0), Vec3d(0.0)};
  for (const CameraGradient<double>& sum : sums) {
    all.turn += sum.turn;
    all.center += sum.center;
  }
  return all;
}

}  // namespace gs
