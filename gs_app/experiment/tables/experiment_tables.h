// SPDX-License-Identifier: Apache-2.0
// The tables of an experiment: results.csv, results.json, results.md and results.tex in its output
// folder, made from the results.json of its runs; quality.svg, made from their metrics.csv; and the
// uncommitted changes of this program. Each file has its own source in this folder.
#pragma once

#include <vector>

#include "gs_app/experiment/experiment_run.h"

namespace gs {

/// Writes the files, each whole or not at all, and returns the number of finished runs. Every
/// run has a row; a run without results is "failed" if `failed` holds its index, otherwise
/// "missing". Means and standard deviations (n - 1) are over the seeds that are finished.
std::size_t write_tables(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                         const std::vector<std::size_t>& failed);

}  // namespace gs
