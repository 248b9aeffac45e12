// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_cells.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "gs_app/run/text.h"

namespace gs {
namespace {

// Of a value that is not negative, or has digits after the point.
std::string number_text(const Metric& metric, double value) {
  if (metric.digits > 0) return fmt::format("{:.{}f}", value / metric.unit, metric.digits);
  return with_commas(std::uint64_t(std::llround(value / metric.unit)));
}

std::string with_spread(const Metric& metric, const std::string& mean,
                        const std::optional<double>& spread) {
  return spread ? mean + " ± " + number_text(metric, *spread) : mean;
}

std::string cell_of(const Metric& metric, const std::optional<Spread>& spread) {
  return spread ? with_spread(metric, number_text(metric, spread->mean), spread->deviation) : "-";
}

std::string cell_of(const Metric& metric, const std::optional<Difference>& difference) {
  if (!difference) return "-";
  const std::string size = number_text(metric, std::abs(difference->mean));
  const bool is_zero = size.find_first_of("123456789") == size.npos;
  const char* sign = is_zero ? "" : difference->mean < 0 ? "-" : "+";
  return with_spread(metric, sign + size, difference->standard_error);
}

TextTable table_with(std::vector<std::string> titles, std::size_t names,
                     const std::vector<Metric>& metrics) {
  for (const Metric& metric : metrics) titles.push_back(metric.title);
  return {std::move(titles), {}, names};
}

std::string share_text(std::size_t count, std::size_t wanted) {
  return fmt::format("{}/{}", count, wanted);
}

}  // namespace

TextTable table_of_means(const std::vector<Group>& groups, const std::vector<Metric>& metrics) {
  TextTable table = table_with({"scene", "config", "runs"}, 2, metrics);
  for (const Group& group : groups) {
    std::vector<std::string> cells = {group.scene, group.config,
                                      share_text(group.rows.size(), group.wanted)};
    for (const Metric& metric : metrics) cells.push_back(cell_of(metric, spread_of(group, metric)));
    table.rows.push_back(std::move(cells));
  }
  return table;
}

TextTable table_of_scene_means(const std::vector<SceneMean>& means,
                               const std::vector<Metric>& metrics) {
  TextTable table = table_with({"config", "seeds"}, 1, metrics);
  for (const SceneMean& mean : means) {
    std::vector<std::string> cells = {mean.config, share_text(mean.seeds.size(), mean.wanted)};
    for (const Metric& metric : metrics) cells.push_back(cell_of(metric, spread_of(mean, metric)));
    table.rows.push_back(std::move(cells));
  }
  return table;
}

TextTable table_of_differences(const std::vector<Comparison>& comparisons,
                               const std::vector<Metric>& metrics) {
  TextTable table = table_with({"config", "scene", "pairs"}, 2, metrics);
  for (const Comparison& comparison : comparisons) {
    std::vector<std::string> cells = {comparison.config,
                                      comparison.scene.empty() ? "all" : comparison.scene,
                                      share_text(comparison.pairs.size(), comparison.wanted)};
    for (const Metric& metric : metrics)
      cells.push_back(cell_of(metric, difference_of(comparison, metric)));
    table.rows.push_back(std::move(cells));
  }
  return table;
}

TextTable table_of_runs(const std::vector<RunRow>& rows, const std::vector<Metric>& metrics) {
  TextTable table = table_with({"scene", "config", "seed", "state"}, 4, metrics);
  for (const RunRow& row : rows) {
    std::vector<std::string> cells = {row.run->scene, row.run->config,
                                      std::to_string(row.run->seed), row.state};
    for (const Metric& metric : metrics) {
      const auto value = value_of(row, metric);
      cells.push_back(value ? number_text(metric, *value) : "-");
    }
    table.rows.push_back(std::move(cells));
  }
  return table;
}

}  // namespace gs
