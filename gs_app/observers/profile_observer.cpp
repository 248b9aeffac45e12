// SPDX-License-Identifier: Apache-2.0
#include "gs_app/observers/profile_observer.h"

#include <spdlog/fmt/fmt.h>

#include <numeric>

#include "gs_app/run/csv.h"
#include "gs_app/run/provenance.h"
#include "gs_app/run/results.h"

namespace gs {
namespace {

const std::string kProfileHeader = "step,quantity,name,value\n";
constexpr const char* kCheckpointStage = "look";  // checks the model before a checkpoint

}  // namespace

ProfileObserver::ProfileObserver(const RunFolder& folder, const EvaluationObserver& evaluations,
                                 LostWrites& lost, const std::string& rows)
    : evaluations_(evaluations), file_(folder.profile(), kProfileHeader, rows, lost) {}

std::string ProfileObserver::rows_up_to(const std::filesystem::path& profile, int step) {
  return csv_rows_up_to(profile, kProfileHeader, step);
}

void ProfileObserver::after_rollback(int step, Trainer& trainer) {
  trainer.backend().device().set_profiling(false);
  file_.cut_after(step);
  is_timing_ = false;
  timed_step_ = 0;
}

void ProfileObserver::after_step(int step, Trainer& trainer) {
  if (is_timing_) {
    trainer.backend().device().set_profiling(false);
    is_timing_ = false;
    timed_step_ = evaluations_.at(step) ? 0 : step;  // an evaluation renders as well
  }
  if (step % trainer.config().train.log_every != 0) return;
  write_rows(step, trainer);
  timed_step_ = 0;
  if (step == trainer.schedule().steps()) return;
  trainer.backend().device().set_profiling(true);
  is_timing_ = true;
}

void ProfileObserver::write_rows(int step, Trainer& trainer) {
  std::string rows;
  if (timed_step_)
    for (const StageTime& time : trainer.backend().device().stage_times())
      if (time.stage != kCheckpointStage)
        rows +=
            fmt::format("{},stage_ms,{},{:.4f}\n", timed_step_, csv_cell(time.stage),
                        std::accumulate(time.milliseconds.begin(), time.milliseconds.end(), 0.0f));
  rows += fmt::format("{},memory_bytes,host,{}\n", step, host_bytes());
  if (const auto bytes = gpu_bytes(trainer.backend()))
    rows += fmt::format("{},memory_bytes,gpu,{}\n", step, *bytes);
  file_.add(rows);
}

}  // namespace gs
