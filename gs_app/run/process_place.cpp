// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/process_place.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <cctype>
#include <charconv>
#include <cstdlib>
#include <utility>

#include "gs_core/error.h"

namespace gs {
namespace {

constexpr int kMostProcesses = 1 << 16;

std::string text_of(const Variables& variables, const char* name) {
  const char* const value = variables(name);
  return value ? value : "";
}

// A whole number below `limit`.
std::optional<int> number_of(const Variables& variables, const char* name, int limit) {
  const std::string text = text_of(variables, name);
  if (text.empty()) return std::nullopt;
  int number = -1;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() || number < 0 || number >= limit)
    throw UsageError(
        fmt::format("the environment variable {} is {}, which is no whole number "
                    "below {}; unset it, or start the program again",
                    name, printable(text), limit));
  return number;
}

// The variables of a starter; nothing where it has started no others.
std::optional<ProcessPlace> place_by(const Variables& variables, const char* rank_name,
                                     const char* count_name) {
  const auto rank = number_of(variables, rank_name, kMostProcesses);
  const auto count = number_of(variables, count_name, kMostProcesses);
  if (!rank || !count || *count < 2) return std::nullopt;
  if (*rank >= *count)
    throw UsageError(fmt::format("the environment says that this is process {} ({}) of {} ({})",
                                 *rank, rank_name, *count, count_name));
  ProcessPlace place;
  place.rank = *rank;
  place.count = *count;
  return place;
}

// A job's name in letters that a file may have.
std::string file_of(std::string job) {
  for (char& c : job)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '.' && c != '-') c = '_';
  return job;
}

}  // namespace

std::optional<ProcessPlace> process_place(const Variables& variables) {
  if (auto place = place_by(variables, "SLURM_PROCID", "SLURM_STEP_NUM_TASKS")) {
    place->on_machine = number_of(variables, "SLURM_LOCALID", kMostProcesses);
    place->job = file_of("slurm-" + text_of(variables, "SLURM_JOB_ID") + "." +
                         text_of(variables, "SLURM_STEP_ID"));
    return place;
  }
  for (const auto& [rank, count] : {std::pair{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
                                    std::pair{"PMI_RANK", "PMI_SIZE"}})
    if (auto place = place_by(variables, rank, count)) {
      // Open MPI names the job; without a name, ranks of one machine have the same parent.
      std::string job = text_of(variables, "PMIX_NAMESPACE");
      if (job.empty()) job = text_of(variables, "OMPI_MCA_ess_base_jobid");
      if (job.empty()) job = std::to_string(::getppid());
      place->job = file_of("mpi-" + job);
      for (const char* const name : {"OMPI_COMM_WORLD_LOCAL_RANK", "MPI_LOCALRANKID"})
        if (!place->on_machine) place->on_machine = number_of(variables, name, kMostProcesses);
      return place;
    }
  return std::nullopt;
}

int first_gpu_of(const ProcessPlace& place, int first, int gpus, int visible) {
  if (visible == gpus) return 0;
  // Without a word of the starter all processes are taken to be on this machine.
  const int gpu = first + gpus * place.on_machine.value_or(place.rank);
  if (gpu + gpus > visible)
    throw UsageError(
        fmt::format("process {} needs the GPU cuda:{}, and it sees {}; start fewer processes on a "
                    "machine, or let srun give each its own GPUs (--gpus-per-task={})",
                    place.rank, gpu + gpus - 1,
                    visible == 1 ? "only cuda:0" : fmt::format("{}", visible), gpus));
  return gpu;
}

std::optional<ProcessPlace> process_place() {
  return process_place([](const char* name) { return std::getenv(name); });
}

}  // namespace gs
