// SPDX-License-Identifier: Apache-2.0
#include "gs_train/schedule.h"

#include <algorithm>
#include <cmath>

namespace gs {
namespace {

constexpr double kStandardSteps = 30000;  // length of the run that the steps in the config refer to
constexpr int kMinRefineFrom = 300;  // steps; earlier statistics are unreliable: docs/schedule.md
// steps; shorter ones see each view too rarely: docs/schedule.md
constexpr int kMinRefineInterval = 100;
constexpr int kMinResetInterval = 1000;  // steps; opacities need as many to recover from a reset
constexpr int kExtraResetStep = 500;     // on a white background; Kerbl et al. 2023, code

}  // namespace

Schedule::Schedule(const Config& config, float scene_extent, std::size_t views)
    : views_(int(views)), rates_(config.optimizer), extent_(scene_extent) {
  steps_ =
      std::max(1, int(std::lround(double(config.train.iterations) * config.train.steps_scaler)));
  extra_steps_ = config.train.extra_steps;
  const DensityConfig& density = config.density;
  refine_from_ = std::max(scaled(density.from_step), std::min(density.from_step, kMinRefineFrom));
  refine_until_ = refine_from_ + scaled(density.until_step) - scaled(density.from_step);
  refine_every_ = std::max(scaled(density.every), std::min(density.every, kMinRefineInterval));
  refine_every_ = std::max(refine_every_, density.every_epochs * views_);
  reset_every_ = std::max(scaled(density.reset_opacity_every),
                          std::min(density.reset_opacity_every, kMinResetInterval));
  reset_until_ = scaled(density.reset_opacity_until);
  extra_reset_ = config.render.background == Background::white ? scaled(kExtraResetStep) : 0;
  // the run is too short to recover from it
  if (extra_reset_ < kExtraResetStep / 2) extra_reset_ = 0;
  sh_every_ = scaled(config.train.sh_degree_every);
  morton_every_ = scaled(config.train.morton_every);
  morton_until_ = scaled(config.train.morton_until);
}

int Schedule::scaled(int step) const {
  return std::max(1, int(std::lround(step * (steps_ / kStandardSteps))));
}

LearningRates Schedule::learning_rates(int step) const {
  const double t = std::min(1.0, double(step) / steps_);
  const double position = std::exp((1 - t) * std::log(rates_.position_lr_initial) +
                                   t * std::log(rates_.position_lr_final));
  LearningRates rates;
  rates.mean = float(position * extent_);
  rates.log_scale = rates_.log_scale_lr;
  rates.rotation = rates.right_rotation = rates_.rotation_lr;
  rates.logit_opacity = rates_.opacity_lr;
  rates.sh0 = rates_.sh0_lr;
  rates.sh_rest = rates_.sh_rest_lr;
  rates.has_time = true;  // whether or not the model has
  rates.time_mean = rates_.time_mean_lr;
  rates.log_time_scale = rates_.log_time_scale_lr;
  return rates;
}

bool Schedule::refine(int step) const {
  return step >= refine_from_ && step <= refine_until_ && step % refine_every_ == 0;
}

double Schedule::growth_share(int step) const {
  const int until = std::min(refine_until_, int(steps_)), last = until - until % refine_every_;
  if (step >= last) return 1;
  return std::max(0.0, double(step - refine_from_) / double(last - refine_from_));
}

bool Schedule::has_seen_all_views(int step) const {
  const int previous = step - refine_every_;
  return views_ > 0 && (previous >= refine_from_ ? refine_every_ : step) >= views_;
}

bool Schedule::reset_opacity(int step) const {
  return (step % reset_every_ == 0 && step <= reset_until_) || step == extra_reset_;
}

bool Schedule::raise_sh_degree(int step) const { return step % sh_every_ == 0; }

bool Schedule::reorder(int step) const {
  return step % morton_every_ == 0 && step <= morton_until_;
}

bool Schedule::gather_statistics(int step) const { return step <= refine_until_; }

bool Schedule::prune_large(int step) const {
  return step > reset_every_ && reset_every_ <= reset_until_;
}

}  // namespace gs
