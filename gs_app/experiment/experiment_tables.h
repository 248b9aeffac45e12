// SPDX-License-Identifier: Apache-2.0
// What an experiment came to: results.csv, results.json and results.md in its output folder, from the results.json
// of its runs.
#pragma once

#include <vector>

#include "gs_app/experiment/experiment_run.h"

namespace gs {

/// Writes the three files, each whole or not at all. Every run has a row; one without results is "missing", or "failed"
/// where `failed` has its index. Means and standard deviations (n - 1) are over the seeds that are finished. Returns how
/// many runs are.
std::size_t write_tables(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                         const std::vector<std::size_t>& failed);

/// "25.31 dB, 0.8123": the figures of one finished run in a few words.
std::string figures_of(const ExperimentRun& run);

}  // namespace gs
