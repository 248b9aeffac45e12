// SPDX-License-Identifier: Apache-2.0
// Stage 5 for photos with a depth map: scale and shift of the map, the loss, and its gradient
// (math/depth_loss.h).
#include "gs_core/math/loss/depth_loss.h"

#include <vector>

#include "gs_core/error.h"
#include "gs_core/image.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

constexpr std::size_t kRowsAtATime = 8;

// One photo's map, its mask, and what was rendered.
struct ComparedDepth {
  const View& view;
  const RenderPass& pass;

  std::size_t width() const { return std::size_t(view.depth.width); }
  std::size_t height() const { return std::size_t(view.depth.height); }
  std::size_t pixels() const { return width() * height(); }
  float value(std::size_t i) const { return view.depth.pixels[i]; }
  float mask(std::size_t i) const {
    return view.mask.empty() ? 1.0f : view.mask.pixels[i] * kPerByte;
  }
  float depth_sum(std::size_t i) const { return pass.depth_image[i]; }
  float coverage(std::size_t i) const { return 1 - pass.transmittance[i]; }
};

// Rows in parallel, then the rows' sums one after the other: any number of threads has these bits.
DepthSums sums_of(const ComparedDepth& compared, const DepthTarget* before) {
  const DepthKind kind = compared.view.depth_kind;
  std::vector<DepthSums> rows(compared.height());
  parallel_for(rows.size(), kRowsAtATime, [&](std::size_t row) {
    for (std::size_t i = row * compared.width(); i < (row + 1) * compared.width(); ++i)
      if (is_known_depth(compared.value(i)) && compared.mask(i) > 0)
        add_to(rows[row], depth_sums_of_pixel(
                              kind, double(compared.value(i)), double(compared.mask(i)),
                              double(compared.depth_sum(i)), double(compared.coverage(i)), before));
  });
  DepthSums sums;
  for (const DepthSums& row : rows) add_to(sums, row);
  return sums;
}

}  // namespace

double compare_depth(const View& view, float weight, const RenderPass& pass, DepthGradient& dL) {
  const HostStage stage("depth loss");
  const ComparedDepth compared{view, pass};
  const std::size_t plane = compared.pixels();
  GS_CHECK(pass.depth_image.size() == plane &&
           (view.mask.empty() || view.mask.pixels.size() == plane));
  const DepthTarget target =
      fitted_depth_target(view.depth_kind, double(weight),
                          [&](const DepthTarget* before) { return sums_of(compared, before); });
  dL.depth.resize_discard(plane);
  dL.alpha.resize_discard(plane);
  std::vector<double> rows(compared.height());
  parallel_for(rows.size(), kRowsAtATime, [&](std::size_t row) {
    for (std::size_t i = row * compared.width(); i < (row + 1) * compared.width(); ++i) {
      double loss;
      const DepthPixelGradient<float> gradient =
          depth_pixel_vjp(view.depth_kind, target, compared.value(i), compared.mask(i),
                          compared.depth_sum(i), compared.coverage(i), &loss);
      dL.depth[i] = gradient.Z;
      dL.alpha[i] = gradient.A;
      rows[row] += loss;
    }
  });
  double sum = 0;
  for (const double row : rows) sum += row;
  return sum;
}

}  // namespace gs
