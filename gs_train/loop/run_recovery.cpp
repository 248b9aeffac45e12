// SPDX-License-Identifier: Apache-2.0
#include "gs_train/loop/run_recovery.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <new>

#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_train/initialize/initialize.h"
#include "gs_train/loop/view_sampler.h"
#include "gs_train/photometric/photometric_start.h"
#include "gs_train/poses/poses.h"

namespace gs {
namespace {

// Share of all Gaussians. So few that are not finite are an accident that pruning mends.
constexpr double kToleratedShare = 1e-3;

ViewSampler sampler_of(const TrainingRun& run) {
  return ViewSampler(run.scene.train_views.size(), run.config.train.seed);
}

// The order of the views in the epoch of a step, as checkpoints have it.
std::vector<std::uint32_t> view_order(const TrainingRun& run, int step) {
  ViewSampler views = sampler_of(run);
  views.view_of(std::max(step, 1));
  return {views.order().begin(), views.order().end()};
}

// Releases the capacity that arrays have beyond their rows, as far as there is memory for the
// copies.
void shrink(TrainingModel& model) {
  for (const Column& column : model.columns()) {
    try {
      column.rows->shrink();
    } catch (const Error&) {  // stays as it is
    }
  }
}

// Releases moments and statistics: a finished model needs its parameters alone.
void release_history(TrainingModel& model) {
  for (const Column& column : model.columns())
    if (column.role != RowRole::parameter) column.rows->release();
}

// Runs f(). Where memory runs out returns false, with the message in `error`.
bool fits_into_memory(const std::function<void()>& f, std::string& error) {
  try {
    f();
    return true;
  } catch (const Error& failure) {
    if (failure.code() != ExitCode::out_of_memory) throw;
    error = failure.what();
  } catch (const std::bad_alloc&) {
    error = "out of memory";
  }
  return false;
}

}  // namespace

RunRecovery::RunRecovery(TrainingRun& run)
    : run_(run), timer_(run.config.train.checkpoint_every), guard_(run.scene.train_views.size()) {}

// ---- memory ------------------------------------------------------------------------------------

void RunRecovery::guarded(const std::string& what, const std::function<void()>& f) {
  if (!fits(what, f))
    throw Error(fmt::format("out of memory in {} even after all caches were released: {}", what,
                            memory_error_),
                ExitCode::out_of_memory);
}

void RunRecovery::guarded_or_skipped(const std::string& what, const std::function<void()>& f) {
  if (!fits(what, f))
    log_warning("step {}: {} is skipped for lack of memory: {}", run_.step, what, memory_error_);
}

// Runs the work. If memory runs out, releases memory and runs it again. Returns whether that fitted.
bool RunRecovery::fits(const std::string& what, const std::function<void()>& f) {
  if (run_.backend.features().is_shared) return f(), true;  // the others would go another way
  if (fits_into_memory(f, memory_error_)) return true;
  release_memory(what);
  return fits_into_memory(f, memory_error_);
}

void RunRecovery::release_memory(const std::string& what) {
  run_.density->set_growth_cap(std::int64_t(std::max<std::size_t>(run_.model.count(), 1)));
  std::string error;
  bool is_kept = false;
  fits_into_memory([&] { is_kept = save(); }, error);
  run_.backend.release_caches();
  if (phase_ == Phase::finished) release_history(run_.model);
  shrink(run_.model);
  if (!is_kept) fits_into_memory([&] { is_kept = save(); }, error);
  log_warning("out of memory in {} after step {} ({}); caches are released{}{}", what, run_.step,
              memory_error_, is_kept ? ", a checkpoint is kept" : "",
              phase_ == Phase::training
                  ? fmt::format(", and the model stays at {} Gaussians", run_.model.count())
                  : "");
}

// ---- breakdowns --------------------------------------------------------------------------------

void RunRecovery::check_watched_step() {
  if (!guard_.is_watching(run_.step)) return;
  check_loss(run_.backend.loss().value());
  if (is_sound()) check_parameters();
}

void RunRecovery::check_loss(double loss) {
  if (!std::isfinite(loss)) breakdown_ = "the loss is not a number";
}

void RunRecovery::check_parameters() {
  std::size_t bad = 0;
  guarded_or_skipped("a check of the parameters",
                     [&] { bad = run_.backend.rows().count_not_finite(run_.model); });
  const std::size_t count = run_.model.count();
  if (double(bad) > kToleratedShare * double(count))
    breakdown_ = fmt::format("{} of {} Gaussians are not finite", bad, count);
  else if (bad && run_.schedule.refine(run_.step))
    log_warning("step {}: {} of {} Gaussians are not finite, and are removed", run_.step, bad,
                count);
}

void RunRecovery::check_is_not_empty() {
  if (run_.model.count() > 0) return;
  breakdown_ = "no Gaussian is left";
  blames_view_ = false;
}

void RunRecovery::roll_back() {
  if (run_.backend.features().is_shared)
    throw Error(
        fmt::format("step {}: {}, and a run of several processes does not go back; resume it "
                    "with one process",
                    run_.step, breakdown_));
  const std::size_t view = guard_.instead_of(sampler_of(run_).view_of(run_.step));
  const std::string event = guard_.note_breakdown(run_.step, breakdown_, blames_view_, view,
                                                  run_.scene.train_views[view].name);
  breakdown_.clear();
  blames_view_ = true;
  std::optional<TrainingState> state = store_ ? store_->newest() : std::nullopt;
  if (!state) {
    state.emplace();
    state->progress.view_order = view_order(run_, 0);
    state->model = initial_model(run_.scene, run_.config, host_memory());
  }
  log_warning("{}; training goes back to {}", event,
              state->progress.step ? fmt::format("the checkpoint of step {}", state->progress.step)
                                   : std::string("its start"));
  restore(std::move(*state));
}

// ---- checkpoints -------------------------------------------------------------------------------

bool RunRecovery::checkpoint_or_roll_back(int before, bool is_stopped) {
  if (is_sound() && checkpoint_is_due(before, is_stopped)) keep_checkpoint();
  if (is_sound()) return false;
  roll_back();
  return true;
}

bool RunRecovery::checkpoint_is_due(int before, bool is_stopped) const {
  const bool is_kept_at_the_end = run_.config.train.checkpoint_every >= 0;
  return is_stopped || (run_.is_over() && is_kept_at_the_end) || timer_.due(before, run_.step);
}

// Keeps a checkpoint only of a valid model, because a run could not go on from another one.
void RunRecovery::keep_checkpoint() {
  if (!store_) return;
  check_parameters();
  if (is_sound()) check_loss(run_.loss());
  if (is_sound()) guarded_or_skipped("a checkpoint", [&] { save(); });
}

bool RunRecovery::save() {
  if (!store_ || phase_ != Phase::training) return false;
  const auto begin = CheckpointTimer::Clock::now();
  const RunProgress now = progress();
  const bool is_kept = store_->save(now, run_.synchronized_model());
  timer_.note_written(begin);
  return is_kept;
}

RunProgress RunRecovery::progress() {
  RunProgress progress;
  progress.step = run_.step;
  progress.sh_degree = run_.settings.sh_degree;
  if (run_.step > 0) check_loss(progress.loss = run_.loss());
  progress.train_seconds = run_.train_seconds;
  progress.growth_cap = run_.density->growth_cap();
  progress.strikes = guard_.strikes();
  progress.view_order = view_order(run_, run_.step);
  return progress;
}

void RunRecovery::resume(TrainingState from) {
  if (from.progress.strikes.size() != run_.scene.train_views.size())
    throw Error(fmt::format(
        "{} has {} training views, but the run had {}; train on the scene of the run",
        run_.scene.source, run_.scene.train_views.size(), from.progress.strikes.size()));
  const MomentStorage storage = from.model.moment_storage();
  if (storage != run_.config.optimizer.moments)
    throw UsageError(
        fmt::format("the state to resume has its moments as optimizer.moments={0} stores them; set "
                    "optimizer.moments={0}, or start a new run",
                    word_of(storage)));
  guard_.restore(from.progress.strikes);
  restore(std::move(from));
}

void RunRecovery::restore(TrainingState from) {
  const RunProgress& progress = from.progress;
  if (progress.view_order != view_order(run_, progress.step))
    throw Error(
        "the checkpoint has another order of views than this seed gives: it is of another scene or "
        "version; start a new run in another folder (-o)");
  begin_photometric(run_.config, run_.scene, from.model);
  begin_poses(run_.config, run_.scene, from.model);
  run_.backend.synchronize(run_.model);
  Memory& memory = run_.model.memory();
  run_.model = &memory == &host_memory() ? std::move(from.model) : copy_to(memory, from.model);
  run_.step = progress.step;
  run_.first_step = run_.step + 1;
  run_.settings.sh_degree = progress.sh_degree;
  run_.restored_loss = progress.loss;
  run_.train_seconds = std::max(run_.train_seconds, progress.train_seconds);
  DensityControl& density = *run_.density;
  if (density.growth_cap() == 0 || progress.growth_cap < density.growth_cap())
    density.set_growth_cap(progress.growth_cap ? progress.growth_cap : density.growth_cap());
}

}  // namespace gs
