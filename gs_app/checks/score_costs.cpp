// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checks/score_costs.h"

#include <algorithm>

#include "gs_core/config/config_words.h"

namespace gs {
namespace {

constexpr int kRounds = 5;

}  // namespace

std::vector<ScoreCost> score_costs(Backend& backend, TrainingModel& model,
                                   const std::vector<View>& views, const RenderSettings& settings,
                                   const Config& config, const BenchmarkPlan& plan) {
  std::vector<ScoreCost> costs = {{"none"}};
  std::vector<DensityStep> steps = {{}};
  for (const GrowthScore score : {GrowthScore::gradient, GrowthScore::force}) {
    costs.push_back({std::string(word_of(score))});
    steps.push_back({.gather_statistics = true, .score = score});
  }
  // Every step of a way begins at the same view, so that all ways take the same ones.
  const auto milliseconds_of = [&](const DensityStep& step, int count) {
    std::size_t next = 0;
    return milliseconds_of_steps(backend, model, views, settings, config, step, count, next) /
           count;
  };
  for (const DensityStep& step : steps) milliseconds_of(step, std::max(1, plan.warmup));
  std::vector<std::vector<double>> milliseconds(steps.size()), ratios(steps.size());
  for (int round = 0; round < kRounds; ++round)
    for (std::size_t i = 0; i < steps.size(); ++i) {
      milliseconds[i].push_back(milliseconds_of(steps[i], plan.steps));
      ratios[i].push_back(milliseconds[i].back() / milliseconds[0].back());
    }
  for (std::size_t i = 0; i < steps.size(); ++i) {
    costs[i].ms_per_step = median(milliseconds[i]);
    costs[i].ratio = median(ratios[i]);
  }
  return costs;
}

}  // namespace gs
