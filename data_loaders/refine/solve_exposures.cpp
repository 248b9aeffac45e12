// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/refine/solve_exposures.h"

#include <algorithm>

#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

/// The largest number of samples in all photos together: more would add nothing to three numbers
/// per photo.
constexpr std::size_t kMostColorSamples = 1000000;

void log_exposures(const ExposureFit& fit) {
  float lowest = 1, highest = 1;
  for (const Vec3f& exposure : fit.exposures) {
    lowest = std::min({lowest, exposure.x, exposure.y, exposure.z});
    highest = std::max({highest, exposure.x, exposure.y, exposure.z});
  }
  log_info(
      "exposures from {} colors of shared points: {:.2f} to {:.2f}; a point's colors differ by "
      "{:.1f} % between photos without them, by {:.1f} % with them",
      fit.sample_count, lowest, highest, 100 * fit.spread_before, 100 * fit.spread_after);
}

}  // namespace

ExposureFit fit_view_exposures(const std::vector<ScenePoint>& points,
                               const std::vector<std::vector<SeenPoint>>& seen,
                               const std::vector<bool>& is_test, const std::vector<View>& views) {
  std::size_t count = 0;
  for (const auto& of_view : seen) count += of_view.size();
  // one point in so many is sampled
  const auto every = std::uint32_t(count / kMostColorSamples + 1);
  std::vector<std::vector<ColorSample>> by_view(views.size());
  const auto sample = [&](std::size_t i, const View& view) {
    std::vector<std::uint32_t> sampled;
    for (const SeenPoint& point : seen[i])
      if (point.point % every == 0) sampled.push_back(point.point);
    by_view[i] = sample_colors(view, std::uint32_t(i), points, sampled);
  };
  if (views.front().source)  // its budget is for one photo in use
    for_each_with_photo(views, views.size(), sample);
  else
    parallel_for(views.size(), 1, [&](std::size_t i) { sample(i, views[i]); });
  std::vector<ColorSample> samples;
  for (const auto& some : by_view) samples.insert(samples.end(), some.begin(), some.end());
  return fit_exposures(samples, is_test);
}

ExposureSummary take_exposures(const ExposureFit& fit, std::vector<View>& views) {
  for (std::size_t i = 0; i < views.size(); ++i) views[i].exposure = fit.exposures[i];
  for (const std::size_t photo : fit.unknown)
    log_warning(
        "{} shares too few well-exposed points with other photos to find its exposure: it stays as "
        "it is",
        views[photo].name);
  log_exposures(fit);
  return {fit.sample_count, fit.spread_before, fit.spread_after};
}

}  // namespace gs
