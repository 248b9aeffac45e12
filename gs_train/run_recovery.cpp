// SPDX-License-Identifier: Apache-2.0
// What the trainer does where not all goes well: checkpoints, the way back to them, and a lack of memory.
// docs/checkpoints.md has the whole story.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <new>

#include "gs_core/error.h"
#include "gs_core/log.h"
#include "gs_train/initialize.h"
#include "gs_train/trainer.h"

namespace gs {
namespace {

// Of all Gaussians; so few that are not finite are an accident that pruning mends.
constexpr double kToleratedShare = 1e-3;

std::vector<std::uint32_t> view_order(const Scene& scene, const Config& config, int step) {
  ViewSampler views(scene.train_views.size(), config.train.seed);
  views.view_of(std::max(step, 1));
  return {views.order().begin(), views.order().end()};
}

// Gives back what the arrays hold beyond their rows, as far as there is room for the copies.
void shrink(TrainingModel& model) {
  const auto shrink_array = [](const char*, auto& array) {
    try {
      array.shrink();
    } catch (const Error&) {  // stays as it is
    }
  };
  for_each_array(shrink_array, model.gaussians);
  for_each_array(shrink_array, model.first_moment);
  for_each_array(shrink_array, model.second_moment);
  shrink_array("visits", model.statistics.visits);
  shrink_array("gradient_norm", model.statistics.gradient_norm);
}

// Runs f(). Where memory runs out returns false, and in `trouble` what was said.
bool fits_into_memory(const std::function<void()>& f, std::string& trouble) {
  try {
    f();
    return true;
  } catch (const Error& error) {
    if (error.code() != ExitCode::out_of_memory) throw;
    trouble = error.what();
  } catch (const std::bad_alloc&) {
    trouble = "out of memory";
  }
  return false;
}

}  // namespace

// ---- breakdowns -----------------------------------------------------------------------------------------

// After a step that is watched.
void Trainer::look_at_model() {
  if (!std::isfinite(backend_.loss().value()))
    breakdown_ = "the loss is not a number";
  else
    is_sound();
}

bool Trainer::is_sound() {
  std::size_t bad = 0;
  if_there_is_room("a look at the model", [&] { bad = backend_.rows().count_not_finite(model_); });
  if (double(bad) <= kToleratedShare * double(model_.count())) {
    if (bad && schedule_.refine(step_))
      log_warning("step {}: {} of {} Gaussians are not finite, and are removed", step_, bad,
                  model_.count());
    return true;
  }
  breakdown_ = fmt::format("{} of {} Gaussians are not finite", bad, model_.count());
  return false;
}

void Trainer::roll_back() {
  const std::size_t view = guard_.instead_of(views_.view_of(step_));
  const std::string event =
      guard_.note_breakdown(step_, breakdown_, blames_view_, view, scene_.train_views[view].name);
  breakdown_.clear();
  blames_view_ = true;
  std::optional<TrainingState> state = checkpoints_ ? checkpoints_->newest() : std::nullopt;
  if (!state) {
    state.emplace();
    state->progress.view_order = view_order(scene_, config_, 0);
    state->model = initial_model(scene_, config_, host_memory());
  }
  log_warning("{}; training goes back to {}", event,
              state->progress.step ? fmt::format("the checkpoint of step {}", state->progress.step)
                                   : std::string("its start"));
  restore(std::move(*state));
  begin();
  for (Observer* observer : observers_) observer->after_rollback(step_, *this);
}

// ---- checkpoints ----------------------------------------------------------------------------------------

RunProgress Trainer::progress() {
  RunProgress progress;
  progress.step = step_;
  progress.sh_degree = settings_.sh_degree;
  progress.loss = step_ > 0 ? loss() : 0;
  progress.train_seconds = train_seconds_;
  progress.growth_cap = density_->growth_cap();
  progress.strikes = guard_.strikes();
  progress.view_order = view_order(scene_, config_, step_);
  return progress;
}

void Trainer::restore(TrainingState from) {
  const RunProgress& progress = from.progress;
  if (progress.view_order != view_order(scene_, config_, progress.step))
    throw Error(
        "the checkpoint's order of views is not what this seed gives: it is of another "
        "scene or version; train anew in another folder (-o)");
  backend_.synchronize(model_);
  const bool is_here = &backend_.memory() == &host_memory();
  model_ = is_here ? std::move(from.model) : copy_to(backend_.memory(), from.model);
  step_ = progress.step;
  first_step_ = step_ + 1;
  settings_.sh_degree = progress.sh_degree;
  restored_loss_ = progress.loss;
  train_seconds_ = std::max(train_seconds_, progress.train_seconds);
  if (density_->growth_cap() == 0 || progress.growth_cap < density_->growth_cap())
    density_->set_growth_cap(progress.growth_cap ? progress.growth_cap : density_->growth_cap());
}

bool Trainer::save_state() {
  if (!checkpoints_ || is_finishing_) return false;
  const auto begin = CheckpointTimer::Clock::now();
  const RunProgress now = progress();
  const bool is_kept = checkpoints_->save(now, model());
  checkpoint_timer_.note_written(begin);
  return is_kept;
}

// Of a model that is worth it: a checkpoint that cannot be gone on from is none.
void Trainer::keep_checkpoint() {
  if (!checkpoints_ || !is_sound()) return;
  loss();  // a breakdown, if it is no number
  if (breakdown_.empty()) if_there_is_room("a checkpoint", [&] { save_state(); });
}

// ---- memory ---------------------------------------------------------------------------------------------

// Runs f(), which changes nothing where memory runs out; then makes room and runs it once more. False where even that
// was too little.
bool Trainer::with_room(const char* what, const std::function<void()>& f) {
  if (fits_into_memory(f, memory_trouble_)) return true;
  make_room(what);
  return fits_into_memory(f, memory_trouble_);
}

// For what training can do without.
void Trainer::if_there_is_room(const char* what, const std::function<void()>& f) {
  if (!with_room(what, f))
    log_warning("step {}: there is no room for {}, which is left out: {}", step_, what,
                memory_trouble_);
}

void Trainer::make_room(const char* what) {
  density_->set_growth_cap(std::int64_t(std::max<std::size_t>(model_.count(), 1)));
  std::string trouble;
  bool is_kept = false;
  fits_into_memory([&] { is_kept = save_state(); }, trouble);
  backend_.release_caches();
  shrink(model_);
  if (!is_kept) fits_into_memory([&] { is_kept = save_state(); }, trouble);
  log_warning(
      "memory ran out for {} after step {} ({}). {}aches are given back, and no more than {} "
      "Gaussians will be trained",
      what, step_, memory_trouble_, is_kept ? "A checkpoint is kept, c" : "C", model_.count());
}

}  // namespace gs
