// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/contributions.h"

#include <algorithm>

#include "gs_app/run/progress_bar.h"
#include "gs_train/density/contribution.h"

namespace gs {

Contributions contributions_of(Renderer& renderer, const GaussiansSpan& gaussians,
                               const std::vector<Camera>& cameras, const RenderSettings& settings,
                               bool show_progress) {
  const std::size_t count = gaussians.mean.size;
  Contributions result{std::vector<float>(count), std::vector<float>(count),
                       std::vector<std::uint32_t>(count)};
  ContributionMeter meter(renderer, gaussians, settings);
  ProgressBar bar(std::int64_t(cameras.size()), show_progress);
  std::int64_t done = 0;
  for (const Camera& camera : cameras) {
    const std::vector<float>& shares = meter.measure(camera);
    for (std::size_t i = 0; i < count; ++i) {
      result.largest[i] = std::max(result.largest[i], shares[i]);
      result.sum[i] += shares[i];
      result.views[i] += shares[i] >= kLeastSeen;
    }
    if (bar.due(++done)) bar.draw(done, "contributions", "view");
  }
  bar.clear();
  return result;
}

}  // namespace gs
