// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_differences.h"

#include <algorithm>
#include <cmath>

namespace gs {
namespace {

const RunRow* partner_of(const RunRow& row, const std::vector<RunRow>& rows,
                         const std::string& baseline) {
  const auto partner = std::find_if(rows.begin(), rows.end(), [&](const RunRow& other) {
    return other.run->config == baseline && other.run->scene == row.run->scene &&
           other.run->seed == row.run->seed;
  });
  return partner == rows.end() ? nullptr : &*partner;
}

}  // namespace

std::vector<Comparison> comparisons_of(const std::vector<RunRow>& rows,
                                       const std::string& baseline) {
  std::vector<Comparison> comparisons;
  if (baseline.empty()) return comparisons;
  std::vector<std::string> configs, scenes = {""};  // "": all scenes
  for (const RunRow& row : rows) {
    if (row.run->config != baseline) add_name(row.run->config, configs);
    add_name(row.run->scene, scenes);
  }
  if (scenes.size() == 2) scenes.erase(scenes.begin());
  for (const std::string& config : configs)
    for (const std::string& scene : scenes) {
      Comparison comparison{scene, config, {}, 0};
      for (const RunRow& row : rows) {
        if (row.run->config != config || (!scene.empty() && row.run->scene != scene)) continue;
        ++comparison.wanted;
        const RunRow* partner = partner_of(row, rows, baseline);
        if (partner && !partner->results.is_null() && !row.results.is_null())
          comparison.pairs.push_back({partner, &row});
      }
      comparisons.push_back(std::move(comparison));
    }
  return comparisons;
}

std::optional<Difference> difference_of(const Comparison& comparison, const Metric& metric) {
  std::vector<double> differences;
  for (const auto& [baseline, run] : comparison.pairs) {
    const auto before = value_of(*baseline, metric), after = value_of(*run, metric);
    if (before && after) differences.push_back(*after - *before);
  }
  const std::optional<Spread> spread = spread_of(differences);
  if (!spread) return std::nullopt;
  Difference difference{spread->mean, std::nullopt};
  if (spread->deviation)
    difference.standard_error = *spread->deviation / std::sqrt(double(differences.size()));
  return difference;
}

}  // namespace gs
