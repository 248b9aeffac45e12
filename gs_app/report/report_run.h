// SPDX-License-Identifier: Apache-2.0
// The report of one run: the contents of its folder as one JSON object, and as report.html. Start
// reading here.
#pragma once

#include "gs_app/pictures/comparison.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/gaussians.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// {"kind": "run", "title", "folder", "scene", "state", "made", "results", "metrics", "stages",
/// "memory", "views", "histograms", "config", "changed", "notes"}. Anything that the folder does
/// not have is left out or null, with a sentence in "notes". Throws Error if the folder holds no run
/// or a file is damaged.
Json run_report(const RunFolder& folder);

/// What a run that has just ended still has in memory; its files may not be written yet.
struct EndedRun {
  std::string results_json;
  int step;
  const GaussianModel& model;
  const ShownViews& pictures;
};

/// Writes report.html of a run that has just ended. If that fails it logs a warning, since the run
/// itself is complete.
void write_final_report(const RunFolder& folder, const EndedRun& run);

}  // namespace gs
