// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/table_markdown.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_app/experiment/table_settings.h"
#include "gs_app/run/provenance.h"
#include "gs_app/run/text.h"
#include "gs_core/config/markdown.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

// As many as the report shows; results.json has all of them.
constexpr std::size_t kHashDigits = 10;

std::string number_text(const Metric& metric, double value) {
  if (metric.digits == 0) return with_commas(std::uint64_t(std::llround(value / metric.unit)));
  return fmt::format("{:.{}f}", value / metric.unit, metric.digits);
}

std::string spread_text(const Group& group, const Metric& metric) {
  const auto spread = spread_of(group, metric);
  if (!spread) return "-";
  const std::string mean = number_text(metric, spread->mean);
  return spread->deviation ? mean + " ± " + number_text(metric, *spread->deviation) : mean;
}

std::string settings_text(const Json& settings) {
  std::vector<std::string> all;
  for (const auto& [key, value] : settings.items())
    all.push_back(fmt::format("`{}` = {}", key, value.dump()));
  return fmt::format("{}", fmt::join(all, ", "));
}

std::string table_of_means(const std::vector<Group>& groups, const std::vector<Metric>& metrics) {
  std::vector<std::string> titles = {"scene", "config", "runs"};
  for (const Metric& metric : metrics) titles.push_back(metric.title);
  std::string text = markdown_header(titles);
  for (const Group& group : groups) {
    std::vector<std::string> cells = {group.scene, group.config,
                                      fmt::format("{}/{}", group.rows.size(), group.wanted)};
    for (const Metric& metric : metrics) cells.push_back(spread_text(group, metric));
    text += markdown_row(cells);
  }
  return text;
}

std::string table_of_runs(const std::vector<RunRow>& rows, const std::vector<Metric>& metrics) {
  std::vector<std::string> titles = {"scene", "config", "seed", "state"};
  for (const Metric& metric : metrics) titles.push_back(metric.title);
  std::string text = markdown_header(titles);
  for (const RunRow& row : rows) {
    std::vector<std::string> cells = {row.run->scene, row.run->config,
                                      std::to_string(row.run->seed), row.state};
    for (const Metric& metric : metrics) {
      const auto value = value_of(row, metric);
      cells.push_back(value ? number_text(metric, *value) : "-");
    }
    text += markdown_row(cells);
  }
  return text;
}

std::string table_of_scenes(const std::vector<SceneRow>& scenes) {
  std::string text = markdown_header({"scene", "its own settings", "configs", "training views",
                                      "test views", "size / px", "hash"});
  for (const SceneRow& scene : scenes) {
    const std::string settings = settings_text(scene.settings);
    if (scene.variants.empty())
      text += markdown_row({scene.name, settings, "-", "-", "-", "-", "-"});
    for (const auto& [views, configs] : scene.variants)
      text += markdown_row(
          {scene.name, settings,
           scene.variants.size() == 1 ? "all" : fmt::format("{}", fmt::join(configs, ", ")),
           std::to_string(views.train_views), std::to_string(views.test_views), views.size,
           views.scene_hash.substr(0, kHashDigits)});
  }
  return text;
}

std::string table_of_configs(const Experiment& experiment) {
  std::string text = markdown_header({"config", "settings that differ from the defaults"});
  for (const ExperimentConfig& config : experiment.configs)
    text += markdown_row({config.name, settings_text(settings_json(experiment, config))});
  return text;
}

// Each combination of build and machine once: usually there is one.
std::string table_of_machines(const std::vector<RunRow>& rows) {
  const std::vector<const char*> keys = {"version", "commit", "device", "cpu", "driver"};
  std::string text = markdown_header({"version", "commit", "device", "CPU", "driver"});
  std::vector<std::string> seen;
  for (const RunRow& row : rows) {
    if (row.results.is_null()) continue;
    std::vector<std::string> cells;
    for (const char* key : keys) {
      const auto value = row.results.find(key);
      const bool is_text = value != row.results.end() && value->is_string();
      cells.push_back(is_text ? value->get<std::string>() : "-");
    }
    const std::string line = markdown_row(cells);
    if (std::find(seen.begin(), seen.end(), line) != seen.end()) continue;
    seen.push_back(line);
    text += line;
  }
  return text;
}

}  // namespace

std::string experiment_markdown(const Experiment& experiment, const std::vector<SceneRow>& scenes,
                                const std::vector<RunRow>& rows, const std::vector<Group>& groups,
                                std::size_t finished) {
  const std::vector<Metric> metrics = metrics_in(rows);
  return fmt::format(
      "# {}\n\n{} of {} runs are finished. Means and standard deviations over seeds; written "
      "{}.\n\n{}\n"
      "## Runs\n{}\n"
      "## Scenes\nA scene's own settings override those of the configs.\n\n{}\n"
      "## Configs\n{}\n"
      "## Made with\n{}",
      experiment.file.filename().string(), finished, rows.size(), utc_date(),
      table_of_means(groups, metrics), table_of_runs(rows, metrics), table_of_scenes(scenes),
      table_of_configs(experiment), table_of_machines(rows));
}

}  // namespace gs
