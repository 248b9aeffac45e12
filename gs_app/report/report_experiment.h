// SPDX-License-Identifier: Apache-2.0
// The report of an experiment, from the results.json of its output folder and the curves of its runs.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

namespace gs {

/// {"kind": "experiment", "title", "file", "date", "made", "summary", "runs": [{"scene", "config", "seed", "state", "settings",
/// "results", "metrics", "report"}], "notes"}: summary and runs as in results.json, with the columns of each run's metrics.csv, and
/// where its report is from here. Curves that cannot be read are left out, and said in "notes". Throws Error where
/// results.json is missing or damaged.
nlohmann::ordered_json experiment_report(const std::filesystem::path& output);

/// Whether the folder has the results.json of an experiment.
bool holds_experiment(const std::filesystem::path& output);

/// Writes OUTPUT/report.html. Where that cannot be done says so to the user: the tables are there.
void keep_experiment_report(const std::filesystem::path& output);

}  // namespace gs
