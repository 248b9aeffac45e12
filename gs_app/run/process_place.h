// SPDX-License-Identifier: Apache-2.0
// Which process of a run this one is, as srun or mpirun says that has started it
// (docs/method/several_gpus.md).
#pragma once

#include <functional>
#include <optional>
#include <string>

namespace gs {

struct ProcessPlace {
  int rank = 0, count = 1;
  // Which of the processes on its machine it is; nothing where the starter does not say.
  std::optional<int> on_machine = {};
  std::string job;  // a name that all processes of this start have, and no others
};

/// The value of an environment variable; null: it is not set.
using Variables = std::function<const char*(const char*)>;

/// Nothing where the process is alone. A step of srun and a job of mpirun with several tasks count,
/// but not a batch script, which has some of Slurm's variables, too. Throws UsageError where the
/// variables contradict each other.
///
///   srun     SLURM_PROCID SLURM_STEP_NUM_TASKS SLURM_LOCALID SLURM_JOB_ID SLURM_STEP_ID
///   mpirun   OMPI_COMM_WORLD_RANK _SIZE _LOCAL_RANK, or PMI_RANK PMI_SIZE MPI_LOCALRANKID
std::optional<ProcessPlace> process_place(const Variables& variables);
/// By this process' environment.
std::optional<ProcessPlace> process_place();

/// The first of the `gpus` GPUs of a process, of `visible` ones that it sees: those of its machine
/// from `first` on, in the order of its processes. A process that sees no more than it needs, as with
/// srun --gpus-per-task, takes those. Throws UsageError where there are too few.
int first_gpu_of(const ProcessPlace& place, int first, int gpus, int visible);

}  // namespace gs
