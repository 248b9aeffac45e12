// SPDX-License-Identifier: Apache-2.0
#include "gs_train/density/contribution.h"

#include "gs_core/math/render/sh.h"
#include "gs_core/threads/parallel.h"

namespace gs {

ContributionMeter::ContributionMeter(Renderer& renderer, const GaussiansSpan& gaussians,
                                     const RenderSettings& settings)
    : renderer_(renderer), settings_(settings), gaussians_(gaussians),
      sh0_(gaussians.mean.size, renderer.memory()),
      host_gradient_(gaussians.mean.size, host_memory()), dL_dimage_(renderer.memory()),
      dL_dmean2d_(gaussians.mean.size, renderer.memory()),
      gradients_(gaussians.mean.size, renderer.memory(), gaussians.has_time),
      pass_(renderer.memory()), shares_(gaussians.mean.size) {
  sh0_.fill_zero();  // gray, so that no channel is clamped
  gaussians_.sh0 = sh0_.span();
  settings_.sh_degree = 0;
  settings_.background = Vec3f(0);
  settings_.absolute_gradient = false;
  settings_.for_backward = true;
}

const std::vector<float>& ContributionMeter::measure(const Camera& camera) {
  const std::size_t plane = std::size_t(camera.width) * std::size_t(camera.height);
  if (dL_dimage_.size() != 3 * plane) {  // 1 in the first channel
    std::vector<float> gradient(3 * plane, 0.0f);
    std::fill_n(gradient.begin(), plane, 1.0f);
    dL_dimage_.upload(gradient);
  }
  renderer_.forward(gaussians_, camera, settings_, pass_);
  renderer_.backward(gaussians_, camera, settings_, pass_, dL_dimage_.span(), gradients_.span(),
                     dL_dmean2d_.span());
  if (!shares_.empty())
    renderer_.memory().download(host_gradient_.data(), gradients_.sh0.data(),
                                shares_.size() * sizeof(Vec3f));
  parallel_for(shares_.size(), 4096,
               [&](std::size_t i) { shares_[i] = host_gradient_[i].x / float(kSh0); });
  return shares_;
}

}  // namespace gs
