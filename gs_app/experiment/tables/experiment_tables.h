// SPDX-License-Identifier: Apache-2.0
// The tables of an experiment in its output folder: results.json, made from the results.json of its
// runs, and its views results.md and results.csv; and the uncommitted changes of this program.
#pragma once

#include <string>
#include <vector>

#include "gs_app/experiment/experiment_run.h"

namespace gs {

/// Writes the files, each whole or not at all, and returns the number of finished runs. Every
/// run has a row; a run without results is "failed" if `failed` holds its index, otherwise
/// "missing". Means and standard deviations (n - 1) are over the seeds that are finished.
std::size_t write_tables(const Experiment& experiment, const std::vector<ExperimentRun>& runs,
                         const std::vector<std::size_t>& failed);

/// "psnr 25.31, ssim 0.8123": the image metrics of one finished run in a few words.
std::string summary_of(const ExperimentRun& run);

}  // namespace gs
