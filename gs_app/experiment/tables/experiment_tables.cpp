// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/tables/experiment_tables.h"

#include <algorithm>

#include "gs_app/experiment/tables/quality_curves.h"
#include "gs_app/experiment/tables/table_csv.h"
#include "gs_app/experiment/tables/table_json.h"
#include "gs_app/experiment/tables/table_latex.h"
#include "gs_app/experiment/tables/table_markdown.h"

namespace gs {

std::size_t write_tables(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                         const std::vector<std::size_t>& failed) {
  const std::filesystem::path& output = experiment.output;
  const std::vector<RunRow> rows = rows_of(runs, failed);
  const std::vector<Group> groups = groups_of(rows);
  const std::vector<SceneRow> scenes = scenes_of(experiment, rows);
  const std::vector<SceneMean> means = scene_means_of(rows);
  const std::vector<Comparison> comparisons = comparisons_of(rows, experiment.baseline);
  const std::vector<Metric> metrics = metrics_in(rows);
  const PaperTables tables = {table_of_means(groups, metrics), table_of_scene_means(means, metrics),
                              table_of_differences(comparisons, metrics), experiment.baseline};
  const Provenance provenance = provenance_of_this_program();
  const auto finished = std::size_t(std::count_if(
      rows.begin(), rows.end(), [](const RunRow& row) { return !row.results.is_null(); }));
  if (const auto& changes = provenance.uncommitted)
    write_text(output / diff_file_name(*changes), changes->diff);
  write_text(output / "results.csv", experiment_csv(rows));
  write_text(output / "results.json",
             experiment_json(experiment, scenes, rows, groups, means, comparisons, provenance));
  write_text(output / "results.md",
             experiment_markdown(experiment, scenes, rows, tables, provenance, finished));
  write_text(output / "results.tex", experiment_latex(experiment.file.filename().string(), tables));
  if (const std::string picture = quality_curves(rows); !picture.empty())
    write_text(output / "quality.svg", picture);
  return finished;
}

}  // namespace gs
