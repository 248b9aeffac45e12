// SPDX-License-Identifier: Apache-2.0
#include "gs_app/report/report_histograms.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gs_core/math/render/activations.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

constexpr int kOpacityBars = 50, kScaleBars = 60;
constexpr double kTail = 0.001;  // share of the Gaussians on either side that the range leaves out

// The quantile of `values`.
float quantile(std::vector<float>& values, double share) {
  if (values.empty()) return 0;
  const auto at = values.begin() + std::ptrdiff_t(share * double(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

Json histogram(std::vector<float>& values, double from, double to, int bars) {
  std::vector<std::size_t> counts(std::size_t(bars), 0);
  for (const float value : values) {
    const double bar = (value - from) / (to - from) * bars;
    ++counts[std::size_t(std::clamp(bar, 0.0, double(bars - 1)))];
  }
  return {{"from", from}, {"to", to}, {"counts", counts}, {"median", quantile(values, 0.5)}};
}

}  // namespace

Json model_histograms(const GaussianModel& model) {
  std::vector<float> opacities, longest, shortest;
  const std::size_t count = model.gaussians.count();
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3f& scale = model.gaussians.log_scale[i];
    const float logit = model.gaussians.logit_opacity[i];
    if (!std::isfinite(scale.x + scale.y + scale.z) || std::isnan(logit)) continue;
    constexpr float kPerDecade = float(std::numbers::log10e);
    opacities.push_back(sigmoid(logit));
    longest.push_back(kPerDecade * std::max({scale.x, scale.y, scale.z}));
    shortest.push_back(kPerDecade * std::min({scale.x, scale.y, scale.z}));
  }
  // Rounded to tenths of a decade; the range is never empty.
  const double from = std::floor(10.0 * quantile(shortest, kTail)) / 10;
  const double to = std::max(std::ceil(10.0 * quantile(longest, 1 - kTail)) / 10, from + 0.1);
  Json long_axes = {{"name", "longest"}}, short_axes = {{"name", "shortest"}};
  long_axes.update(histogram(longest, from, to, kScaleBars));
  short_axes.update(histogram(shortest, from, to, kScaleBars));
  return {{"count", count},
          {"opacity", histogram(opacities, 0, 1, kOpacityBars)},
          {"scales", {long_axes, short_axes}},
          {"out_of_range", count - opacities.size()}};
}

}  // namespace gs
