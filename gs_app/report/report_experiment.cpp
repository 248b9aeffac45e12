// SPDX-License-Identifier: Apache-2.0
#include "gs_app/report/report_experiment.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_app/report/report_curves.h"
#include "gs_app/report/report_page.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/plain_message.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostRows = 300;  // of each run's curves

fs::path results_file(const fs::path& output) { return output / "results.json"; }

// results.json may come from a stranger: no file outside of OUTPUT is read for it.
bool stays_inside(const fs::path& folder) {
  return folder.is_relative() && std::none_of(folder.begin(), folder.end(),
                                              [](const fs::path& part) { return part == ".."; });
}

Json run_json(const fs::path& output, const Json& run, std::vector<std::string>& notes) {
  // The run's folder inside OUTPUT, not the path in results.json: OUTPUT may have been moved since.
  const std::string folder =
      fmt::format("{}/{}/seed{}", run.at("scene").get<std::string>(),
                  run.at("config").get<std::string>(), run.at("seed").get<std::uint64_t>());
  Json json;
  for (const char* key : {"scene", "config", "seed", "state", "settings", "results"})
    json[key] = run.at(key);
  if (!stays_inside(folder)) {
    notes.push_back(fmt::format(
        "{} leads out of the experiment's folder, so its curves are left out.", folder));
    return json;
  }
  try {
    json["metrics"] = metrics_columns(output / folder / "metrics.csv", kMostRows);
  } catch (const Error& error) {
    notes.push_back(error.what());
  }
  std::error_code ignored;
  if (fs::exists(output / folder / "report.html", ignored))
    json["report"] = folder + "/report.html";
  return json;
}

}  // namespace

Json experiment_report(const fs::path& output) {
  const Json results = read_json(results_file(output));
  std::vector<std::string> notes;
  constexpr const char* kRemedy = "`gemsplat experiment FILE --gather` writes it again";
  return take_from_json(results_file(output), kRemedy, [&] {
    Json report = {{"kind", "experiment"},
                   {"title", fs::path(results.at("experiment").get<std::string>()).stem().string()},
                   {"file", results.at("experiment")},
                   {"date", results.at("date")},
                   {"made", made_by()},
                   {"summary", results.at("summary")},
                   {"scenes", results.at("scenes")},
                   {"configs", results.at("configs")},
                   {"runs", Json::array()}};
    // tables of earlier versions have none of these
    for (const char* key : {"scene_means", "baseline", "differences", "provenance"})
      if (results.contains(key)) report[key] = results.at(key);
    for (const Json& run : results.at("runs"))
      report["runs"].push_back(run_json(output, run, notes));
    report["notes"] = notes;
    return report;
  });
}

bool holds_experiment(const fs::path& output) {
  std::error_code ignored;
  if (!fs::is_regular_file(results_file(output), ignored)) return false;
  return read_json(results_file(output)).contains("experiment");
}

void keep_experiment_report(const fs::path& output) {
  if (!can_write_reports()) return;
  try {
    write_report(output / "report.html", experiment_report(output));
  } catch (const std::exception& error) {
    log_warning("{} was not written: {}", (output / "report.html").string(), plain_message(error));
  }
}

}  // namespace gs
