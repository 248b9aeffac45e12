// SPDX-License-Identifier: Apache-2.0
#include "gs_core/bake_filter.h"

#include <algorithm>
#include <cmath>

#include "gs_core/math/render/activations.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr double kFaintestLogit = -80;  // keeps the opacity of a point that the filter blurs finite

/// The logit of c o, where o = sigmoid(x). Logarithms keep digits where o is near 1.
double logit_of_product(double x, double log_c) {
  const double o = sigmoid(x), rest = sigmoid(-x) - o * std::expm1(log_c);  // 1 - c o
  return std::max(log_c + std::log(o) - std::log(rest), kFaintestLogit);
}

}  // namespace

void bake_filter(Gaussians& gaussians) {
  if (!gaussians.has_filter) return;
  parallel_for(gaussians.count(), 4096, [&](std::size_t i) {
    if (gaussians.filter_scale[i] == 0) return;
    const double f = std::abs(double(gaussians.filter_scale[i]));
    double log_c = 0;
    for (int axis = 0; axis < 3; ++axis) {
      float& log_scale = gaussians.log_scale[i][axis];
      const double ratio = std::log1p(std::exp(2 * (std::log(f) - double(log_scale))));
      log_c -= 0.5 * ratio;  // ratio = log((s^2 + f^2) / s^2)
      log_scale = float(double(log_scale) + 0.5 * ratio);
    }
    gaussians.logit_opacity[i] = float(logit_of_product(double(gaussians.logit_opacity[i]), log_c));
  });
  gaussians.has_filter = false;
  gaussians.filter_scale = Buffer<float>(gaussians.memory());
}

}  // namespace gs
