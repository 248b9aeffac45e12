// SPDX-License-Identifier: Apache-2.0
// Which rank of a run this process is, as whoever has started it says.
#pragma once

#include <functional>
#include <optional>
#include <string>

namespace gs {

struct RankPlace {
  int rank = 0, count = 1;
  bool is_ours = false;  // started by rank 0; else by srun or mpirun
  // Of others: which of the ranks on its machine it is; nothing where the starter does not say.
  std::optional<int> on_machine = {};
  // Of ranks that are ours: where rank 0 listens on this machine, and the word that it expects.
  int port = 0;
  std::string nonce;
  // Of others: the file in which rank 0 writes both. All ranks work in the same folder.
  std::string meeting_file;
};

/// The value of an environment variable; null: it is not set.
using Variables = std::function<const char*(const char*)>;

/// Nothing where the process is alone. A step of srun and a job of mpirun with several tasks count,
/// but not a batch script, which has some of Slurm's variables, too. Throws UsageError where the
/// variables contradict each other.
///
///   ours     GS_RANK GS_RANKS GS_RANK_PORT GS_RANK_NONCE
///   srun     SLURM_PROCID SLURM_STEP_NUM_TASKS SLURM_LOCALID SLURM_JOB_ID SLURM_STEP_ID
///   mpirun   OMPI_COMM_WORLD_RANK _SIZE _LOCAL_RANK, or PMI_RANK PMI_SIZE MPI_LOCALRANKID
std::optional<RankPlace> rank_place(const Variables& variables);
/// By this process' environment.
std::optional<RankPlace> rank_place();

/// The GPU of a rank, of `visible` ones that its process sees: those of its machine from `first`
/// on, in the order of its ranks. A process that sees one GPU alone, as with srun
/// --gpus-per-task=1, takes that. Throws UsageError where there are too few.
int gpu_of(const RankPlace& place, int first, int visible);

}  // namespace gs
