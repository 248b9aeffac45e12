// SPDX-License-Identifier: Apache-2.0
#include "gs_app/report/report_folder.h"

#include "gs_app/report/report_experiment.h"
#include "gs_app/report/report_page.h"
#include "gs_app/report/report_run.h"
#include "gs_core/error.h"
#include "gs_core/system/text/json.h"

namespace gs {

void check_can_report(const std::filesystem::path& folder) {
  if (!std::filesystem::is_directory(folder))
    throw UsageError(folder.string() +
                     " is not a folder; name the folder of a run (train -o) or the output folder "
                     "of an experiment");
}

Json folder_report(const std::filesystem::path& folder) {
  check_can_report(folder);
  return holds_experiment(folder) ? experiment_report(folder) : run_report(RunFolder(folder));
}

std::filesystem::path write_folder_report(const std::filesystem::path& folder,
                                          const std::filesystem::path& file) {
  if (!can_write_reports()) throw Error(cannot_write_reports());  // before the work
  write_report(file, folder_report(folder));
  return file;
}

}  // namespace gs
