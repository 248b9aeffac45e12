// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/slurm.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <iostream>

#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/system/processes/subprocess.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// The indices as Slurm writes them: "0-3,7".
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

// A line of a script; a name with a line end would begin a command of its own.
std::string line_of(const std::string& text) {
  for (const unsigned char c : text)
    if (c < 0x20 || c == 0x7f)
      throw UsageError(fmt::format(
          "\"{}\" has control characters, which a script for sbatch cannot hold; rename "
          "the file or folder, or change the option in [slurm]",
          printable(text)));
  return text + "\n";
}

bool asks_for_gpus(const std::string& option) {
  return option.starts_with("--gres") || option.starts_with("--gpus");
}

}  // namespace

std::string array_script(const Experiment& experiment,
                         const std::vector<const ExperimentRun*>& runs, int gpus_per_run) {
  std::string text = "#!/bin/bash\n";
  const fs::path logs = experiment.output / "slurm" / "%A_%a.log";
  std::vector<std::string> options = {
      "--job-name=" + shell_word(experiment.file.stem().string()), "--array=" + index_ranges(runs),
      "--output=" + shell_word(logs.string()),
      "--signal=B:TERM@60",  // a minute before the time limit, so that a run can save a checkpoint
  };
  if (gpus_per_run > 0 &&
      std::none_of(experiment.slurm.begin(), experiment.slurm.end(), asks_for_gpus))
    options.push_back(fmt::format("--gres=gpu:{}", gpus_per_run));
  options.insert(options.end(), experiment.slurm.begin(), experiment.slurm.end());
  for (const std::string& option : options) text += line_of("#SBATCH " + option);
  text +=
      "# One task for each unfinished run of the experiment; written by gemsplat experiment "
      "--slurm.\n";
  const std::string gpus = gpus_per_run > 0 ? fmt::format(" --gpus-per-run {}", gpus_per_run) : "";
  return text + line_of(fmt::format(
                    "exec {} experiment {}{} --only \"$SLURM_ARRAY_TASK_ID\"",
                    shell_word(std::filesystem::weakly_canonical(program_to_start()).string()),
                    shell_word(experiment.file.string()), gpus));
}

void submit(const Experiment& experiment, const std::vector<const ExperimentRun*>& runs,
            int gpus_per_run, bool dry_run) {
  const std::string gather =
      fmt::format("gemsplat experiment {} --gather", shell_word(experiment.file.string()));
  if (runs.empty()) {
    std::cout << fmt::format("all runs are finished; write the tables with: {}\n", gather);
    return;
  }
  const fs::path script = experiment.output / "experiment.sbatch";
  write_text(script, array_script(experiment, runs, gpus_per_run));
  std::error_code error;
  fs::create_directories(experiment.output / "slurm", error);  // Slurm makes no folders
  if (error)
    throw Error(
        fmt::format("cannot make {}: {}", (experiment.output / "slurm").string(), error.message()));
  std::cout << fmt::format("sbatch {}\n", shell_word(script.string())) << std::flush;
  if (!dry_run) {
    if (!find_program("sbatch"))
      throw Error(fmt::format(
          "there is no sbatch on the PATH; run this on a machine of the cluster: sbatch {}",
          shell_word(script.string())));
    const auto print = [](std::string_view line) { std::cout << line << '\n'; };
    if (!run_process({"sbatch", script.string()}, {}, print).good())
      throw Error("sbatch failed on " + script.string() +
                  "; check its options in [slurm] of the experiment's file");
  }
  std::cout << fmt::format("write the tables, now or later, with: {}\n", gather);
}

}  // namespace gs
