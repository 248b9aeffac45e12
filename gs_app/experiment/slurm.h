// SPDX-License-Identifier: Apache-2.0
// Submits an experiment to Slurm as a job array with one task for each run.
#pragma once

#include <filesystem>
#include <vector>

#include "gs_app/experiment/experiment_run.h"

namespace gs {

/// The script for sbatch. Each task runs `gemsplat experiment FILE --only INDEX` for one of `runs`.
/// Options in [slurm] of the experiment's file become #SBATCH lines. With `gpus_per_run` above 0
/// each run is trained on so many GPUs, which the script asks for unless [slurm] does.
std::string array_script(const Experiment& experiment,
                         const std::vector<const ExperimentRun*>& runs, int gpus_per_run = 0);

/// Writes the script into the output folder and gives it to sbatch. With `dry_run` it only prints
/// that command. Throws Error if sbatch is missing or fails.
void submit(const Experiment& experiment, const std::vector<const ExperimentRun*>& runs,
            int gpus_per_run, bool dry_run);

}  // namespace gs
