// SPDX-License-Identifier: Apache-2.0
// gemsplat report: report.html of a run or an experiment, made anew.
#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "apps/cli/verbs.h"
#include "gs_app/report/report_experiment.h"
#include "gs_app/report/report_page.h"
#include "gs_app/report/report_run.h"
#include "gs_core/error.h"
#include "gs_core/log.h"

namespace gs {
namespace {

struct ReportCommand {
  std::string folder, output;
  bool json = false;
};

void report(const ReportCommand& command) {
  setup_log(Verbosity::normal);
  const std::filesystem::path folder = command.folder;
  if (!std::filesystem::is_directory(folder))
    throw UsageError(command.folder +
                     " is no folder; name that of a run (train -o) or of an experiment's output");
  if (!command.json && !can_write_reports()) throw Error(cannot_write_reports());
  const nlohmann::ordered_json data =
      holds_experiment(folder) ? experiment_report(folder) : run_report(RunFolder(folder));
  if (command.json) {
    std::cout << data.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) << '\n';
    return;
  }
  const std::filesystem::path file =
      command.output.empty() ? folder / "report.html" : std::filesystem::path(command.output);
  write_report(file, data);
  std::cout << "report: " << file.string() << '\n';
}

}  // namespace

void add_report(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "report", "Write report.html of a run or an experiment: one file that opens in a browser");
  const auto command = std::make_shared<ReportCommand>();
  verb.add_option("folder", command->folder, "a run's folder, finished or not, or an experiment's")
      ->type_name("RUN|EXPERIMENT")
      ->required();
  verb.add_option("-o,--output", command->output, "the file [report.html in the folder]")
      ->type_name("FILE");
  verb.add_flag("--json", command->json, "print the report's data as JSON, and write nothing");
  verb.callback([command] { report(*command); });
}

}  // namespace gs
