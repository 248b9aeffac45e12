// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_means.h"

#include <algorithm>
#include <map>
#include <set>

namespace gs {

std::vector<SceneMean> scene_means_of(const std::vector<RunRow>& rows) {
  std::set<std::string> scenes;
  for (const RunRow& row : rows) scenes.insert(row.run->scene);
  std::vector<SceneMean> means;
  if (scenes.size() < 2) return means;
  std::map<std::string, std::map<std::uint64_t, std::vector<const RunRow*>>> runs;
  for (const RunRow& row : rows) {
    const std::string& config = row.run->config;
    if (!runs.contains(config)) means.push_back({config, {}, 0});
    std::vector<const RunRow*>& of_seed = runs[config][row.run->seed];
    if (!row.results.is_null()) of_seed.push_back(&row);
  }
  for (SceneMean& mean : means) {
    mean.wanted = runs[mean.config].size();
    for (const auto& [seed, of_seed] : runs[mean.config])
      if (of_seed.size() == scenes.size()) mean.seeds.push_back(of_seed);
  }
  return means;
}

std::optional<Spread> spread_of(const SceneMean& mean, const Metric& metric) {
  std::vector<double> values;
  for (const std::vector<const RunRow*>& runs : mean.seeds) {
    double sum = 0;
    for (const RunRow* row : runs) {
      const auto value = value_of(*row, metric);
      if (!value) return std::nullopt;
      sum += *value;
    }
    values.push_back(sum / double(runs.size()));
  }
  return spread_of(values);
}

}  // namespace gs
