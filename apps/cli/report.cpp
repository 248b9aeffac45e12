// SPDX-License-Identifier: Apache-2.0
// gemsplat report: writes report.html of a run or an experiment.
#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "apps/cli/verbs.h"
#include "gs_app/report/report_folder.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"

namespace gs {
namespace {

struct ReportCommand {
  std::string folder, output;
  bool json = false;
};

void report(const ReportCommand& command) {
  setup_log(Verbosity::normal);
  const std::filesystem::path folder = command.folder;
  if (command.json) {
    std::cout << folder_report(folder).dump(2, ' ', false, Json::error_handler_t::replace) << '\n';
    return;
  }
  const std::filesystem::path file =
      command.output.empty() ? folder / "report.html" : std::filesystem::path(command.output);
  check_can_report(folder);
  const OutputLock lock = OutputLock::of_file(file);
  std::cout << "report: " << write_folder_report(folder, file).string() << '\n';
}

}  // namespace

void add_report(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "report", "Write report.html of a run or an experiment: one file for the browser");
  const auto command = std::make_shared<ReportCommand>();
  verb.add_option("folder", command->folder,
                  "folder of a run, finished or not, or of an experiment")
      ->type_name("RUN|EXPERIMENT")
      ->required();
  verb.add_option("-o,--output", command->output, "file to write [report.html in the folder]")
      ->type_name("FILE");
  verb.add_flag("--json", command->json, "print the report's data as JSON and write no file");
  verb.callback([command] { report(*command); });
}

}  // namespace gs
