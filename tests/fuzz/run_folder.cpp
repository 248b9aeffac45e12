// SPDX-License-Identifier: Apache-2.0
// The folder of a run or an experiment as `report` and the tables of experiments read it. Its files
// stand one behind the other in an input.
#include "gs_app/run/run_folder.h"

#include "gs_app/experiment/tables/experiment_json.h"
#include "gs_app/experiment/tables/experiment_tables.h"
#include "gs_app/experiment/tables/experiment_views.h"
#include "gs_app/report/report_folder.h"
#include "gs_app/run/csv.h"
#include "gs_core/system/text/json.h"
#include "gs_model/formats/ply/ply.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/random_model.h"

namespace gs::fuzz {
namespace {

/// The folder of a run with a model, and with the settings of its experiment, which are the defaults.
ExperimentRun make_run() {
  ExperimentRun run;
  run.scene = "scene";
  run.config = "default";
  run.folder = RunFolder(folder() / "run");
  write_gaussian_ply(run.folder.ply(7), random_model(2, 0));
  write_text(run.settings_file(), "");
  return run;
}

void make_tables(const std::vector<ExperimentRun>& runs) {
  Experiment experiment;
  experiment.scenes.push_back({"scene", folder(), {}});
  const Json tables = experiment_json(experiment, runs, {});
  experiment_markdown(tables);
  experiment_csv(tables);
  summary_of(runs[0]);
}

void read(std::string_view bytes) {
  static const std::vector<ExperimentRun> runs = {make_run()};
  const RunFolder& run = runs[0].folder;
  write_files(bytes, {"run/results.json", "run/metrics.csv", "run/profile.csv", "run/split.json",
                      "run/per_view.json", "run/cameras.json", "run/config.toml"});
  takes([&] { folder_report(run.root()); });
  takes([&] { make_tables(runs); });
  takes([&] {
    csv_rows_up_to(run.metrics(), "step,loss", 7);
    last_step_in(run.metrics());
  });
}

const Registered registered{"run_folder", read};

}  // namespace
}  // namespace gs::fuzz
