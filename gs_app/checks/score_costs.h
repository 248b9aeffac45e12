// SPDX-License-Identifier: Apache-2.0
// What the statistics of the scores that training steps gather cost such a step.
#pragma once

#include <string>
#include <vector>

#include "gs_app/checks/benchmark.h"

namespace gs {

struct ScoreCost {
  std::string statistics;  // "none", "gradient" or "force"
  double ms_per_step = 0;  // median of the rounds
  double ratio = 1;  // of this time to that without statistics, the median of the rounds' ratios
};

/// Times training steps that gather nothing, and steps that gather each score, turn by turn in five
/// rounds of plan.steps steps each. Learning rates are zero. The model has sums over fragments
/// afterwards. Takes views that the backend has, as time_training() leaves them.
std::vector<ScoreCost> score_costs(Backend& backend, TrainingModel& model,
                                   const std::vector<View>& views, const RenderSettings& settings,
                                   const Config& config, const BenchmarkPlan& plan);

}  // namespace gs
