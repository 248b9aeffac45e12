// SPDX-License-Identifier: Apache-2.0
#include "gs_app/report/report_run.h"

#include <spdlog/fmt/fmt.h>

#include <future>

#include "gs_app/report/report_curves.h"
#include "gs_app/report/report_histograms.h"
#include "gs_app/report/report_mesh.h"
#include "gs_app/report/report_page.h"
#include "gs_app/report/report_views.h"
#include "gs_core/config/config_diff.h"
#include "gs_core/error.h"
#include "gs_core/system/files/text_file.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/plain_message.h"
#include "gs_core/system/text/read_json.h"
#include "gs_core/threads/start_threads.h"
#include "gs_model/formats/ply/ply.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostCurveRows = 3000;  // of each curve: more than a screen has pixels

// [{"key", "value", "usual"}, ...] for each setting that differs from its default ("usual"), except
// the paths of scene and output.
Json changed_settings(const Config& config) {
  Json changed = Json::array();
  for (const SettingChange& change : config_diff(Config{}, config))
    if (change.key != "dataset.source" && change.key != "model.output")
      changed.push_back({{"key", change.key}, {"value", change.b}, {"usual", change.a}});
  return changed;
}

// A config of another version may have settings that this one does not know. Its text is shown in
// any case.
void add_config(const RunFolder& folder, Json& report, std::vector<std::string>& notes) {
  constexpr std::uint64_t kMostBytes = 1 << 20;
  report["config"] = "";
  report["changed"] = Json::array();
  Config config;
  try {
    if (fs::exists(folder.config())) {
      report["config"] = read_text_file(folder.config(), kMostBytes);
      load_config(config, folder.config().string());
    }
    report["changed"] = changed_settings(config);
    report["scene"] = config.dataset.source;
  } catch (const Error& error) {
    notes.push_back(error.what());
  }
  // The scene of `train PHOTOS` is OUT/scene, and has no name of its own.
  const fs::path scene = config.dataset.source;
  const fs::path run = fs::absolute(folder.root() / "").lexically_normal().parent_path();
  std::error_code ignored;
  const bool has_name = scene.has_filename() && !fs::equivalent(scene.parent_path(), run, ignored);
  report["title"] = (has_name ? scene : run).filename().string();
}

// What the folder and an ended run have; each of them may lack something.
Json report_of(const RunFolder& folder, Json results, const EndedRun* run) {
  std::vector<std::string> notes;
  Json report = {{"kind", "run"},
                 {"title", ""},
                 {"folder", fs::absolute(folder.root()).lexically_normal().string()},
                 {"state", results.is_null() ? "unfinished" : "finished"},
                 {"made", made_by()}};
  add_config(folder, report, notes);
  report["metrics"] = metrics_columns(folder.metrics(), kMostCurveRows);
  report.update(profile_columns(folder.profile(), kMostCurveRows));
  const std::optional<int> step = run ? run->step : folder.newest_step();
  if (run) {
    Json histograms;
    std::future<void> counted =
        in_background([&] { histograms = model_histograms(run->model); });  // beside the pictures
    report["views"] = report_views(folder, *step, run->pictures, notes);
    counted.get();
    report["histograms"] = std::move(histograms);
  } else if (step) {
    report["views"] = report_views(folder, *step, {}, notes);
    report["histograms"] = model_histograms(read_gaussian_ply(folder.ply(*step)));
    report["mesh"] = report_mesh(folder, *step, notes);
  } else {
    notes.push_back("No model is saved yet, so there are no views and no histograms.");
  }
  report["results"] = std::move(results);
  report["notes"] = notes;
  return report;
}

}  // namespace

Json run_report(const RunFolder& folder) {
  if (!folder.holds_run())
    throw Error("the folder " + folder.root().string() +
                " holds no run; name the folder that was given to `gemsplat train -o`");
  return report_of(folder, fs::exists(folder.results()) ? read_json(folder.results()) : Json(),
                   nullptr);
}

void write_final_report(const RunFolder& folder, const EndedRun& run) {
  if (!can_write_reports()) return log_info("no report.html: {}", cannot_write_reports());
  try {
    write_report(folder.report(), report_of(folder, Json::parse(run.results_json), &run));
  } catch (const std::exception& error) {
    log_warning("{} was not written: {}; `gemsplat report {}` writes it", folder.report().string(),
                plain_message(error), folder.root().string());
  }
}

}  // namespace gs
