// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/slurm.h"

#include <spdlog/fmt/fmt.h>

#include <iostream>

#include "gs_core/error.h"
#include "gs_core/io/subprocess.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// One word of a shell's command, whatever is in it.
std::string quoted(const std::string& text) {
  constexpr const char* kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789/._-+=%";
  if (!text.empty() && text.find_first_not_of(kPlain) == text.npos) return text;
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

// "0-3,7": indices in rising order.
std::string index_ranges(const std::vector<const ExperimentRun*>& runs) {
  std::string text;
  for (std::size_t first = 0, last = 0; first < runs.size(); first = last + 1) {
    last = first;
    while (last + 1 < runs.size() && runs[last + 1]->index == runs[last]->index + 1) ++last;
    text += text.empty() ? "" : ",";
    text += std::to_string(runs[first]->index);
    if (last > first) text += fmt::format("-{}", runs[last]->index);
  }
  return text;
}

}  // namespace

std::string array_script(const Experiment& experiment,
                         const std::vector<const ExperimentRun*>& runs) {
  std::string text = "#!/bin/bash\n";
  const fs::path logs = experiment.output / "slurm" / "%A_%a.log";
  std::vector<std::string> options = {
      "--job-name=" + experiment.file.stem().string(), "--array=" + index_ranges(runs),
      "--output=" + quoted(logs.string()),
      "--signal=B:TERM@60",  // a minute before the time is up, so that a run can save
  };
  options.insert(options.end(), experiment.slurm.begin(), experiment.slurm.end());
  for (const std::string& option : options) text += fmt::format("#SBATCH {}\n", option);
  return text + fmt::format(
                    "# One task for each unfinished run of the experiment; written by gemsplat "
                    "experiment --slurm.\n"
                    "exec {} experiment {} --only \"$SLURM_ARRAY_TASK_ID\"\n",
                    quoted(own_program().string()), quoted(experiment.file.string()));
}

void submit(const Experiment& experiment, const std::vector<const ExperimentRun*>& runs,
            bool dry_run) {
  const std::string gather =
      fmt::format("gemsplat experiment {} --gather", quoted(experiment.file.string()));
  if (runs.empty()) {
    std::cout << fmt::format("all runs are finished; the tables: {}\n", gather);
    return;
  }
  const fs::path script = experiment.output / "experiment.sbatch";
  write_text(script, array_script(experiment, runs));
  std::error_code error;
  fs::create_directories(experiment.output / "slurm", error);  // Slurm makes no folders
  if (error)
    throw Error(
        fmt::format("cannot make {}: {}", (experiment.output / "slurm").string(), error.message()));
  std::cout << fmt::format("sbatch {}\n", quoted(script.string())) << std::flush;
  if (!dry_run) {
    if (!find_program("sbatch"))
      throw Error(
          fmt::format("there is no sbatch on the PATH; on a machine of the cluster run: sbatch {}",
                      quoted(script.string())));
    const auto print = [](std::string_view line) { std::cout << line << '\n'; };
    if (!run_process({"sbatch", script.string()}, {}, print).good())
      throw Error("sbatch has refused " + script.string() +
                  "; [slurm] in the experiment's file holds its options");
  }
  std::cout << fmt::format("afterwards, or at any time between: {}\n", gather);
}

}  // namespace gs
