// SPDX-License-Identifier: Apache-2.0
// The report of one run: everything that its folder says, as one JSON object, and as report.html.
#pragma once

#include <nlohmann/json.hpp>

#include "gs_app/run/run_folder.h"

namespace gs {

/// {"kind": "run", "title", "folder", "scene", "state", "made", "results", "metrics", "stages", "memory", "views",
/// "histograms", "config", "changed", "notes"}; what the folder does not have is left out or null, and said in "notes". `results`:
/// those of a run that is about to write them, else null: results.json is read, where there is one.
/// Throws Error where the folder holds no run, or a file is damaged.
nlohmann::ordered_json run_report(const RunFolder& folder,
                                  nlohmann::ordered_json results = nullptr);

/// Writes report.html of a run that has just ended, whose results are these. Where that cannot be done says so to the
/// user; a run is not lost for want of it.
void write_final_report(const RunFolder& folder, const std::string& results_json);

}  // namespace gs
