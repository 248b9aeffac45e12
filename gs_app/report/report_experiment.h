// SPDX-License-Identifier: Apache-2.0
// The report of an experiment: made from results.json in its output folder and from metrics.csv of
// each run.
#pragma once

#include <filesystem>

#include "gs_core/system/text/json.h"

namespace gs {

/// {"kind": "experiment", "title", "file", "date", "made", "summary", "scenes", "configs",
/// "scene_means", "baseline", "differences", "provenance", "runs":
/// [{"scene", "config", "seed", "state", "settings", "results", "metrics", "report"}], "notes"}.
/// All but "metrics" (the columns of the run's metrics.csv) and "report" (the relative path of its
/// report) is copied from results.json. A metrics.csv that cannot be read is left out, with a
/// sentence in "notes". Throws Error if results.json is missing or damaged.
Json experiment_report(const std::filesystem::path& output);

/// Whether the folder has the results.json of an experiment.
bool holds_experiment(const std::filesystem::path& output);

/// Writes OUTPUT/report.html. If that fails it logs a warning, since the tables are there.
void keep_experiment_report(const std::filesystem::path& output);

}  // namespace gs
