// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/experiment_tables.h"

#include <algorithm>

#include "gs_app/experiment/table_csv.h"
#include "gs_app/experiment/table_json.h"
#include "gs_app/experiment/table_markdown.h"

namespace gs {

std::size_t write_tables(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                         const std::vector<std::size_t>& failed) {
  const std::vector<RunRow> rows = rows_of(runs, failed);
  const std::vector<Group> groups = groups_of(rows);
  const std::vector<SceneRow> scenes = scenes_of(experiment, rows);
  const auto finished = std::size_t(std::count_if(
      rows.begin(), rows.end(), [](const RunRow& row) { return !row.results.is_null(); }));
  write_text(experiment.output / "results.csv", experiment_csv(rows));
  write_text(experiment.output / "results.json", experiment_json(experiment, scenes, rows, groups));
  write_text(experiment.output / "results.md",
             experiment_markdown(experiment, scenes, rows, groups, finished));
  return finished;
}

}  // namespace gs
