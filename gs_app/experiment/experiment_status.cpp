// SPDX-License-Identifier: Apache-2.0
#include "gs_app/experiment/experiment_status.h"

#include <spdlog/fmt/fmt.h>

#include "gs_app/run/csv.h"
#include "gs_app/run/text.h"
#include "gs_core/system/log.h"
#include "gs_train/schedule.h"

namespace gs {

namespace {

// A run that has begun knows its length, which may follow from its scene.
int steps_of(const ExperimentRun& run) {
  Config config = run.settings;
  if (std::filesystem::exists(run.folder.config())) load_config(config, run.folder.config());
  return Schedule(config, 1).steps();  // the extent changes only learning rates
}

}  // namespace

std::string status_of(const ExperimentRun& run) {
  const int steps = steps_of(run);
  return fmt::format("{} at step {} of {}", run.name(),
                     with_commas(std::uint64_t(last_step_in(run.folder.metrics()))),
                     with_commas(std::uint64_t(steps)));
}

void StatusLog::started(const ExperimentRun& run) {
  running_.push_back(&run);
  last_line_ = Clock::now();
}

void StatusLog::ended(const ExperimentRun& run) {
  std::erase(running_, &run);
  last_line_ = Clock::now();
}

void StatusLog::waiting(const std::string& before) {
  const Clock::time_point now = Clock::now();
  if (seconds_between_ <= 0 || running_.empty() ||
      std::chrono::duration<double>(now - last_line_).count() < seconds_between_)
    return;
  last_line_ = now;
  std::string text;
  for (const ExperimentRun* run : running_) text += (text.empty() ? "" : ", ") + status_of(*run);
  log_info("{}{}", before, text);
}

}  // namespace gs
