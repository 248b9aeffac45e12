// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/experiment_tables.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_app/experiment/tables/experiment_json.h"
#include "gs_app/experiment/tables/experiment_views.h"
#include "gs_app/experiment/tables/metrics.h"

namespace gs {

std::size_t write_tables(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                         const std::vector<std::size_t>& failed) {
  const std::filesystem::path& output = experiment.output;
  const Json json = experiment_json(experiment, runs, failed);
  if (const auto& changes = uncommitted_changes())
    write_text(output / json.at("provenance").at("uncommitted").at("diff").get<std::string>(),
               changes->diff);
  write_text(output / "results.csv", experiment_csv(json));
  write_text(output / "results.json", file_text(json));
  write_text(output / "results.md", experiment_markdown(json));
  const Json& entries = json.at("runs");
  return std::size_t(std::count_if(entries.begin(), entries.end(),
                                   [](const Json& run) { return !run.at("results").is_null(); }));
}

std::string summary_of(const ExperimentRun& run) {
  const Json results = results_of(run);
  std::string text;
  for (const Metric& metric : all_metrics())
    if (const auto value = value_of(results, metric); value && metric.is_of_views)
      text +=
          fmt::format("{}{} {:.{}f}", text.empty() ? "" : ", ", metric.key, *value, metric.digits);
  return text;
}

}  // namespace gs
