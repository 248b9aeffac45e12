// SPDX-License-Identifier: Apache-2.0
// Stage 7 for runs that refine poses: each visible Gaussian pulls the gradient of its splat back to
// the camera, and all of these are added up.
#include <vector>

#include "gs_core/math/pose/camera_gradient.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"

namespace gs {
namespace {

// Each group of rows has a sum of its own, which rounds less than one long sum.
constexpr std::uint32_t kRowsPerSum = 512;

// What a visible Gaussian adds.
struct CameraGradientRow {
  std::uint32_t row;
  CameraGradient<float> gradient;
};

void add_to(CameraGradient<double>& sum, const Vec3d& turn, const Vec3d& center) {
  sum.turn += turn;
  sum.center += center;
}

std::vector<CameraGradientRow> camera_gradient_rows(const GaussiansSpan& gaussians,
                                                    const Camera& camera,
                                                    const RenderSettings& settings,
                                                    const RenderPass& pass) {
  std::vector<CameraGradientRow> rows;
  for (std::size_t i = 0; i < gaussians.mean.size; ++i)
    if (pass.tile_counts[i]) rows.push_back({std::uint32_t(i), {}});
  parallel_for(rows.size(), kRowsPerSum, [&](std::size_t k) {
    const std::size_t i = rows[k].row;
    rows[k].gradient = camera_vjp(gaussians, i, camera, settings, splat_gradient_of(pass, i));
  });
  return rows;
}

CameraGradient<double> sum_of_rows(const std::vector<CameraGradientRow>& rows) {
  constexpr CameraGradient<double> kZero{Vec3d(0.0), Vec3d(0.0)};
  CameraGradient<double> all = kZero, group = kZero;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (k > 0 && rows[k].row / kRowsPerSum != rows[k - 1].row / kRowsPerSum) {
      add_to(all, group.turn, group.center);
      group = kZero;
    }
    add_to(group, Vec3d(rows[k].gradient.turn), Vec3d(rows[k].gradient.center));
  }
  add_to(all, group.turn, group.center);
  return all;
}

}  // namespace

CameraGradient<double> camera_gradient(const GaussiansSpan& gaussians, const Camera& camera,
                                       const RenderSettings& settings, const RenderPass& pass) {
  const HostStage stage("camera gradient");
  return sum_of_rows(camera_gradient_rows(gaussians, camera, settings, pass));
}

}  // namespace gs
