// SPDX-License-Identifier: Apache-2.0
#include "gs_app/ranks/rank_place.h"

#include <spdlog/fmt/fmt.h>
#include <unistd.h>

#include <cctype>
#include <charconv>
#include <cstdlib>
#include <utility>

#include "gs_core/error.h"

namespace gs {
namespace {

constexpr int kMostRanks = 1 << 16;

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
std::optional<RankPlace> place_by(const Variables& variables, const char* rank_name,
                                  const char* count_name) {
  const auto rank = number_of(variables, rank_name, kMostRanks);
  const auto count = number_of(variables, count_name, kMostRanks);
  if (!rank || !count || *count < 2) return std::nullopt;
  if (*rank >= *count)
    throw UsageError(fmt::format("the environment says that this is rank {} ({}) of {} ({})", *rank,
                                 rank_name, *count, count_name));
  RankPlace place;
  place.rank = *rank;
  place.count = *count;
  return place;
}

// Letters of a job's name that a file may have.
std::string file_of(std::string job) {
  for (char& c : job)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '.' && c != '-') c = '_';
  return ".gemsplat-ranks-" + job;
}

}  // namespace

std::optional<RankPlace> rank_place(const Variables& variables) {
  if (auto place = place_by(variables, "GS_RANK", "GS_RANKS")) {
    place->is_ours = true;
    place->port = number_of(variables, "GS_RANK_PORT", 1 << 16).value_or(0);
    place->nonce = text_of(variables, "GS_RANK_NONCE");
    return place;
  }
  if (auto place = place_by(variables, "SLURM_PROCID", "SLURM_STEP_NUM_TASKS")) {
    place->on_machine = number_of(variables, "SLURM_LOCALID", kMostRanks);
    place->meeting_file = file_of("slurm-" + text_of(variables, "SLURM_JOB_ID") + "." +
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
      place->meeting_file = file_of("mpi-" + job);
      for (const char* const name : {"OMPI_COMM_WORLD_LOCAL_RANK", "MPI_LOCALRANKID"})
        if (!place->on_machine) place->on_machine = number_of(variables, name, kMostRanks);
      return place;
    }
  return std::nullopt;
}

int gpu_of(const RankPlace& place, int first, int visible) {
  if (!place.is_ours && visible == 1) return 0;
  // Without a word of the starter all ranks are taken to be on this machine.
  const int gpu = first + place.on_machine.value_or(place.rank);
  if (gpu >= visible)
    throw UsageError(fmt::format(
        "rank {} needs the GPU cuda:{}, and its process sees {}; start at most as many "
        "ranks on a machine as it has GPUs, or let srun give each its own "
        "(--gpus-per-task=1)",
        place.rank, gpu, visible == 1 ? "only cuda:0" : fmt::format("{} of them", visible)));
  return gpu;
}

std::optional<RankPlace> rank_place() {
  return rank_place([](const char* name) { return std::getenv(name); });
}

}  // namespace gs
