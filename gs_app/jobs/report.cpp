// SPDX-License-Identifier: Apache-2.0
// gemsplat report: writes report.html of a run or an experiment.
#include "gs_app/jobs/verbs.h"
#include "gs_app/report/report_folder.h"
#include "gs_app/run/output_place.h"
#include "gs_app/run/text.h"
#include "gs_core/system/files/output_lock.h"

namespace gs {
namespace {

struct ReportJob : JobSettings {
  std::string folder, output;  // an empty output: report.html in the folder
};

void visit_options(ReportJob& job, OptionList& option) {
  option.json_meaning = "print the report's data as JSON and write no file";
  option("folder", job.folder, "folder of a run, finished or not, or of an experiment")
      .takes("RUN|EXPERIMENT")
      .required();
  option("-o,--output", job.output, "file to write [report.html in the folder]").takes("FILE");
}

Outcome run(const ReportJob& job, JobEvents& events) {
  const std::filesystem::path folder = job.folder;
  if (events.wants_json()) return {"", folder_report(folder)};
  const std::filesystem::path file =
      job.output.empty() ? folder / "report.html" : std::filesystem::path(job.output);
  check_can_report(folder);
  if (job.output.empty()) say_place(file);
  const OutputLock lock = OutputLock::of_file(file);
  const std::string written = write_folder_report(folder, file).string();
  return {"report: " + written + "\n", nullptr, {{"open it", "xdg-open " + shell_word(written)}}};
}

}  // namespace

Verb report_verb() {
  return verb_of<ReportJob>(
      "report", VerbGroup::look,
      "Write report.html of a run or an experiment: one file for the browser",
      {"report out/scene", "report out/scene -o report.html", "report out/scene --json"});
}

}  // namespace gs
