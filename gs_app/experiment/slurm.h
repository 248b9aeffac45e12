// SPDX-License-Identifier: Apache-2.0
// An experiment as a job array of Slurm: one task for each run.
#pragma once

#include <filesystem>
#include <vector>

#include "gs_app/experiment/experiment_run.h"

namespace gs {

/// The script for sbatch: each task does `gemsplat experiment FILE --only INDEX` for one of `runs`. Options of the file's
/// [slurm] stand in it as #SBATCH lines.
std::string array_script(const Experiment& experiment,
                         const std::vector<const ExperimentRun*>& runs);

/// Writes the script into the output folder and gives it to sbatch; with `dry_run` only prints the command that would.
/// Throws Error where there is no sbatch or it refuses.
void submit(const Experiment& experiment, const std::vector<const ExperimentRun*>& runs,
            bool dry_run);

}  // namespace gs
