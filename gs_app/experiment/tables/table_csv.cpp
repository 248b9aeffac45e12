// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/table_csv.h"

#include <spdlog/fmt/fmt.h>

#include "gs_app/run/csv.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

constexpr const char* kProvenance[] = {"iterations", "device",  "cpu",    "driver",
                                       "scene_hash", "version", "commit", "uncommitted",
                                       "compiler",   "cuda",    "date"};

// A cell of results.json; empty if the run does not have it.
std::string cell_of(const RunRow& row, const char* key) {
  if (!row.results.contains(key)) return "";
  const Json& value = row.results[key];
  return csv_cell(value.is_string() ? value.get<std::string>() : value.dump());
}

}  // namespace

std::string experiment_csv(const std::vector<RunRow>& rows) {
  std::string text = "scene,config,seed,state";
  for (const Metric& metric : all_metrics()) text += fmt::format(",{}", metric.key);
  for (const char* key : kProvenance) text += fmt::format(",{}", key);
  text += ",folder\n";
  for (const RunRow& row : rows) {
    text += fmt::format("{},{},{},{}", row.run->scene, row.run->config, row.run->seed, row.state);
    for (const Metric& metric : all_metrics()) {
      const auto value = value_of(row, metric);
      text += value ? fmt::format(",{}", *value) : ",";
    }
    for (const char* key : kProvenance) text += "," + cell_of(row, key);
    text += fmt::format(",{}\n", csv_cell(row.run->folder.root().string()));
  }
  return text;
}

}  // namespace gs
