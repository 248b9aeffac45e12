// SPDX-License-Identifier: Apache-2.0
#include "gs_train/schedule.h"

#include <algorithm>
#include <cmath>

namespace gs {
namespace {

constexpr double kStandardSteps = 30000;  // length of the run that the steps in the config refer to
constexpr int kMinRefineFrom = 300;       // steps; earlier statistics are unreliable
// steps; shorter ones see each view too rarely: docs/method/schedule.md
constexpr int kMinRefineInterval = 100;
constexpr int kMinResetInterval = 1000;  // steps; opacities need as many to recover from a reset
constexpr int kRareFilter = 10;          // refinement intervals between filters after the last one
constexpr int kExtraResetStep = 500;     // on a white background; Kerbl et al. 2023, code
constexpr int kMortonInterval = 5000;    // steps; Faster-GS
constexpr int kPhotometricWarmup = 500;  // steps; PPISP 2026, code
constexpr double kPhotometricFinal = 0.01;  // of the rate, at the first and at the last step
constexpr int kPoseWarmup = 1000;           // steps; the first Gaussians say little of poses
constexpr double kPoseFinal = 0.01;         // of the rate, at the last step
constexpr int kSurfaceInterval = 2;         // updates from one with surface terms to the next
constexpr double kDepthWeightFinal = 0.01;  // of the weight: photos decide in the end
constexpr float kTimeMeanRate = 8e-4f;      // of the duration
constexpr int kRecoveryShare = 3;           // 1 / share of the steps between two resets
constexpr int kLeastRefinements = 10;       // whatever GrowthMethod::every_epochs says

// How much of the steps from + 1 to `until` is over after this one, 0 to 1.
double share_done(int step, int from, int until) {
  return std::min(1.0, double(std::max(step - from, 0)) / double(until - from));
}

}  // namespace

Schedule::Schedule(const Config& config, const GrowthMethod& method, float scene_extent,
                   std::size_t views)
    : views_(int(views)), density_(config.density), method_(method),
      ramp_(config.train.resolution_ramp), ramp_least_(std::size_t(config.train.resolution_least)),
      rates_(config.optimizer), batch_rates_(config.train.batch_rates),
      photometric_rate_(config.photometric.rate),
      pose_rate_(config.poses.refine ? config.poses.rate : 0),
      depth_weight_(config.loss.depth_weight), surface_weights_{config.surface.normal_weight,
                                                                config.surface.photo_weight,
                                                                config.surface.prior_weight},
      extent_(scene_extent) {
  steps_ =
      std::max(1, int(std::lround(double(config.train.iterations) * config.train.steps_scaler)));
  extra_steps_ = config.train.extra_steps;
  plan_refinements();
  plan_pruning();
  extra_reset_ = config.render.background == Background::white ? scaled(kExtraResetStep) : 0;
  // the run is too short to recover from it
  if (extra_reset_ < kExtraResetStep / 2) extra_reset_ = 0;
  sh_every_ = scaled(config.train.sh_degree_every);
  morton_every_ = scaled(kMortonInterval);
  morton_until_ = scaled(config.density.until_step + config.density.every);
  ramp_every_ = scaled(config.train.resolution_every);
  photometric_warmup_ = scaled(kPhotometricWarmup);
  pose_warmup_ = scaled(kPoseWarmup);
  surface_from_ = scaled(config.surface.from_step);
  batch_ = config.train.batch;
  decay_from_ =
      std::min(method_.waits_for_whole_photos ? int(ramp_.size()) * ramp_every_ : 0, steps_ - 1);
  cooldown_from_ = std::min(scaled_or_none(rates_.cooldown_from), steps_ - 1);
}

void Schedule::plan_refinements() {
  const DensityConfig& density = density_;
  refine_from_ = std::max(scaled(density.from_step), std::min(density.from_step, kMinRefineFrom));
  refine_until_ = refine_from_ + scaled(density.until_step) - scaled(density.from_step);
  refine_every_ = std::max(scaled(density.every), std::min(density.every, kMinRefineInterval));
  reset_every_ = std::max(scaled(density.reset_opacity_every),
                          std::min(density.reset_opacity_every, kMinResetInterval));
  reset_until_ = scaled(density.reset_opacity_until);
  const int longest = (refine_until_ - refine_from_) / kLeastRefinements;
  refine_every_ = std::max(refine_every_, std::min(method_.every_epochs * views_, longest));
}

void Schedule::plan_pruning() {
  recovery_until_ = scaled(method_.recovery_until);
  share_prune_from_ = scaled(method_.share_prune_from);
  share_prune_every_ = std::max(scaled(method_.share_prune_every),
                                std::min(method_.share_prune_every, kMinResetInterval));
  share_prune_until_ = scaled(method_.share_prune_until);
}

int Schedule::scaled(int step) const {
  return std::max(1, int(std::lround(step * (steps_ / kStandardSteps))));
}

LearningRates Schedule::learning_rates(int step) const {
  const double t = share_done(step, decay_from_, steps_);
  const double position = std::exp((1 - t) * std::log(rates_.position_lr_initial) +
                                   t * std::log(rates_.position_lr_final));
  const double share = cooldown(step);
  const auto cooled = [&](float rate) { return float(rate * share); };
  LearningRates rates;
  rates.mean = float(position * extent_ * share);
  rates.log_scale = cooled(rates_.log_scale_lr);
  rates.rotation = rates.right_rotation = cooled(rates_.rotation_lr);
  rates.logit_opacity = cooled(rates_.opacity_lr);
  rates.sh0 = cooled(rates_.sh0_lr);
  rates.sh_rest = cooled(rates_.sh_rest_lr);
  rates.has_time = true;  // whether or not the model has
  rates.time_mean = cooled(kTimeMeanRate);
  rates.log_time_scale = cooled(rates_.log_time_scale_lr);
  return rates;
}

double Schedule::cooldown(int step) const {
  return std::pow(double(rates_.cooldown_share), share_done(step, cooldown_from_, steps_));
}

AdamRule Schedule::adam_rule(int photos) const { return batch_rule(batch_rates_ ? photos : 1); }

float Schedule::photometric_rate(int step) const {
  if (recovers_from_reset(step)) return 0;
  const double warm = share_done(step, 0, photometric_warmup_);
  const double t = share_done(step, 0, steps_);
  return float(photometric_rate_ * (kPhotometricFinal + (1 - kPhotometricFinal) * warm) *
               std::pow(kPhotometricFinal, t));
}

float Schedule::pose_rate(int step) const {
  if (recovers_from_reset(step)) return 0;
  const double warm = share_done(step, 0, pose_warmup_);
  const double t = share_done(step, 0, steps_);
  return float(pose_rate_ * warm * std::pow(kPoseFinal, t));
}

float Schedule::depth_weight(int step) const {
  if (!(depth_weight_ > 0)) return 0;
  const double t = share_done(step, 0, steps_);
  return float(depth_weight_ * std::pow(kDepthWeightFinal, t));
}

SurfaceWeights Schedule::surface_weights(int step) const {
  const int update = (step + batch_ - 1) / batch_;
  if (step < surface_from_ || update % kSurfaceInterval != 0) return {};
  const float share = float(kSurfaceInterval);
  return {share * surface_weights_.normal, share * surface_weights_.photo,
          share * surface_weights_.prior};
}

bool Schedule::recovers_from_reset(int step) const {
  const int since = (step - 1) % reset_every_ + 1, reset = step - since;
  return method_.opacity.policy != OpacityPolicy::none && reset > 0 && reset_opacity(reset) &&
         since <= reset_every_ / kRecoveryShare;
}

int Schedule::photo_reduction(int step, const Camera& camera) const {
  const std::size_t stage = std::size_t(step - 1) / std::size_t(ramp_every_);
  int factor = stage < ramp_.size() ? ramp_[stage] : 1;
  const auto pixels = [&] {
    return std::size_t(camera.width / factor) * std::size_t(camera.height / factor);
  };
  while (factor > 1 && pixels() < ramp_least_) --factor;
  return factor;
}

bool Schedule::is_refinement_due(int step) const {
  return step >= refine_from_ && step <= refine_until_ && step % refine_every_ == 0;
}

bool Schedule::refine(int step) const {
  if (!is_refinement_due(step) || recovery_prune(step) > 0) return false;
  const int prune = next_share_prune(step);
  return sensitivity_prune(prune) == 0 || step <= last_epoch(prune).after;
}

double Schedule::growth_share(int step) const {
  const int until = std::min(refine_until_, int(steps_)), last = until - until % refine_every_;
  if (step >= last) return 1;
  return std::max(0.0, double(step - refine_from_) / double(last - refine_from_));
}

// The last whole epoch up to a step. Where there is none, `after` is negative.
Schedule::Steps Schedule::last_epoch(int step) const {
  if (views_ == 0) return {-1, -1};
  const int until = step / views_ * views_;
  return {until - views_, until};
}

// The first refinement in this step or later; 0: there is none.
int Schedule::next_refinement(int step) const {
  int next = std::max(step, refine_from_) + refine_every_ - 1;
  for (next -= next % refine_every_; next <= refine_until_; next += refine_every_)
    if (refine(next)) return next;
  return 0;
}

// The last step before this one after which statistics began with zeros.
int Schedule::last_clearing_before(int step) const {
  for (int before = step - 1; before >= std::min(refine_from_, share_prune_from_); --before)
    if (refine(before) || sensitivity_prune(before) > 0) return before;
  return 0;
}

Schedule::Steps Schedule::steps_of_statistics(int refinement) const {
  const int begin = last_clearing_before(refinement);
  const Steps epoch = last_epoch(refinement);
  const bool takes_epoch = method_.window == StatisticsWindow::epoch && epoch.after >= begin;
  return takes_epoch ? epoch : Steps{begin, refinement};
}

bool Schedule::has_seen_all_views(int step) const {
  return views_ > 0 && last_epoch(step).after >= last_clearing_before(step);
}

int Schedule::next_share_prune(int step) const {
  const int next = step + share_prune_every_ - 1;
  return next - next % share_prune_every_;
}

double Schedule::sensitivity_prune(int step) const {
  if (!method_.prunes_shares()) return 0;
  const Steps epoch = last_epoch(step);
  const bool is_due = step % share_prune_every_ == 0 && step >= share_prune_from_ &&
                      step <= share_prune_until_ && step < steps_;
  if (!is_due || epoch.after < std::max(0, step - share_prune_every_)) return 0;
  return double(step <= refine_until_ ? method_.soft_prune : method_.hard_prune);
}

bool Schedule::measure_sensitivity(int step) const {
  const int prune = next_share_prune(step);
  return sensitivity_prune(prune) > 0 && last_epoch(prune).has(step);
}

double Schedule::recovery_prune(int step) const {
  const int reset = step - method_.recovery_after;
  const bool is_due = reset > 0 && reset_opacity(reset) && reset <= recovery_until_;
  return is_due ? double(method_.recovery_prune) : 0;
}

bool Schedule::reset_opacity(int step) const {
  return (step % reset_every_ == 0 && step <= reset_until_) || step == extra_reset_;
}

bool Schedule::raise_sh_degree(int step) const { return step % sh_every_ == 0; }

bool Schedule::reorder(int step) const {
  return step % morton_every_ == 0 && step <= morton_until_;
}

bool Schedule::gather_statistics(int step) const {
  if (measure_sensitivity(step)) return true;
  if (method_.window == StatisticsWindow::refinement) return step <= refine_until_;
  const int refinement = next_refinement(step);
  return refinement > 0 && steps_of_statistics(refinement).has(step);
}

bool Schedule::measure_filter(int step) const {
  return step % (step <= refine_until_ ? refine_every_ : kRareFilter * refine_every_) == 0;
}

bool Schedule::prune_large(int step) const {
  return step > reset_every_ && reset_every_ <= reset_until_;
}

bool Schedule::prune_late(int step) const {
  return method_.late_prune_opacity > 0 && step >= refine_until_ + reset_every_ &&
         step % reset_every_ == 0 && step < steps_;
}

}  // namespace gs
