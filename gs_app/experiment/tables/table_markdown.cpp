// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_markdown.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_app/experiment/tables/table_settings.h"
#include "gs_app/run/provenance.h"
#include "gs_core/config/text/markdown.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

// As many as the report shows; results.json has all of them.
constexpr std::size_t kHashDigits = 10;

std::string markdown_table(const TextTable& table) {
  std::string text = markdown_header(table.titles);
  for (const std::vector<std::string>& row : table.rows) text += markdown_row(row);
  return text;
}

std::string settings_text(const Json& settings) {
  std::vector<std::string> all;
  for (const auto& [key, value] : settings.items())
    all.push_back(fmt::format("`{}` = {}", key, value.dump()));
  return fmt::format("{}", fmt::join(all, ", "));
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
  const std::vector<const char*> keys = {"version", "commit", "uncommitted", "compiler",
                                         "cuda",    "device", "cpu",         "driver"};
  std::string text = markdown_header(
      {"version", "commit", "uncommitted", "compiler", "CUDA", "device", "CPU", "driver"});
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
                                const std::vector<RunRow>& rows, const PaperTables& tables,
                                const Provenance& provenance, std::size_t finished) {
  std::string text = fmt::format(
      "# {}\n\n{} of {} runs are finished. Means and standard deviations over seeds; written "
      "{}.\n\n{}\n",
      experiment.file.filename().string(), finished, rows.size(), utc_date(),
      markdown_table(tables.means));
  if (!tables.scene_means.rows.empty())
    text += fmt::format(
        "## Means over scenes\nOf seeds whose runs have finished in every scene.\n\n{}\n",
        markdown_table(tables.scene_means));
  if (!tables.differences.rows.empty())
    text += fmt::format(
        "## Differences to {}\nPaired by scene and seed; means ± standard errors.\n\n{}\n",
        experiment.baseline, markdown_table(tables.differences));
  return text + fmt::format(
                    "## Runs\n{}\n"
                    "## Scenes\nA scene's own settings override those of the configs.\n\n{}\n"
                    "## Configs\n{}\n"
                    "## Made with\n{}\n{}",
                    markdown_table(table_of_runs(rows, metrics_in(rows))), table_of_scenes(scenes),
                    table_of_configs(experiment), table_of_machines(rows),
                    provenance_markdown(provenance));
}

}  // namespace gs
