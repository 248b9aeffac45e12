// SPDX-License-Identifier: Apache-2.0
// The order of a run, and its parts from the first step on; start_session.cpp has those before it.
#include "gs_app/session/train_session.h"
#include "gs_eval/evaluate_run.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <set>
#include <string_view>

#include "gs_app/observers/sight_observer.h"
#include "gs_app/report/report_run.h"
#include "gs_app/run/photometric_file.h"
#include "gs_app/run/stop_on_signal.h"
#include "gs_app/session/check_sight.h"
#include "gs_app/session/evaluate_run.h"
#include "gs_app/session/export_run.h"
#include "gs_app/session/save_poses.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/start_threads.h"
#include "gs_model/formats/formats.h"
#include "gs_model/formats/ply/ply.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Rows of metrics.csv and profile.csv that a resumed run keeps.
struct RowsBefore {
  std::string metrics, profile;
};

// The row of the last step in metrics.csv is written at the end, with the evaluation: it is left
// out here.
RowsBefore rows_before(const std::optional<ResumedRun>& resumed, int steps_done, int steps) {
  if (!resumed) return {};
  const RunFolder folder(resumed->source);
  return {metrics_up_to(folder.metrics(), std::min(steps_done, steps - 1)),
          ProfileObserver::rows_up_to(folder.profile(), steps_done)};
}

}  // namespace

struct TrainSession::Observers {
  LostWrites lost;
  ProgressObserver progress;
  SaveObserver saver;
  EvaluationObserver evaluations;
  MetricsObserver metrics;
  SightObserver sight;
  ProfileObserver profile;
  std::optional<DurationObserver> duration;

  Observers(const RunFolder& folder, Trainer& trainer, bool shows_progress, const RowsBefore& rows)
      : progress(trainer.schedule().steps(), shows_progress, trainer.step()), saver(folder, lost),
        evaluations(progress), metrics(folder, evaluations, lost, rows.metrics), sight(progress),
        profile(folder, evaluations, lost, rows.profile) {
    for (Observer* observer : std::initializer_list<Observer*>{&saver, &evaluations, &metrics,
                                                               &progress, &profile, &sight})
      trainer.add_observer(*observer);
    if (&trainer.backend().memory() == &host_memory())  // on a CPU nobody guesses it beforehand
      trainer.add_observer(duration.emplace(progress, trainer));
  }
};

TrainSession::TrainSession(TrainRequest request, SessionHooks& hooks)
    : request_(std::move(request)), clock_(request_.begin), hooks_(hooks) {
  std::set<std::string_view> formats;
  for (const std::string& name : request_.exports) {
    format_named(name).require({});
    if (!formats.insert(format_named(name).ending).second)
      throw UsageError("--export names " + name + " twice; name each format once");
  }
}

TrainSession::~TrainSession() = default;

SessionEnd TrainSession::run() {
  if (request_.place && request_.place->rank > 0) return follow();
  lock_folder();
  for (const std::string& name : request_.exports)
    check_holds(format_named(name), config_.model.dynamic, "--export " + name);
  const bool lacks_exports =
      goes_on_in_place() && !missing_exports(request_.exports, *folder_).empty();
  if (is_finished() && !lacks_exports) {
    log_info("the run in {} is finished; --iterations +N extends it by N steps",
             resumed_->source.string());
    return SessionEnd::nothing_left;
  }
  check_output();
  if (!is_finished()) lpips_ = make_lpips(config_.eval);  // early, before hours of training
  hooks_.use_threads(config_.train.threads);
  if (is_finished()) request_.place.reset();  // the others have nothing to do
  start_backend();
  clock_.end("start");
  get_scene();
  clock_.end("scene");
  if (is_finished()) return end_finished_run();

  if (!resumed_) {  // before the folder: where this throws, none is left behind
    make_new_trainer();
    check_sight(*trainer_);
  }
  hooks_.before_writing(*folder_, *scene_, config_);
  checkpoints_.emplace(folder_->checkpoints(), config_, record_);
  if (resumed_ && resumed_->is_extended && goes_on_in_place())
    save_resumed_state();  // before old results are moved
  start_folder();
  if (resumed_ && !goes_on_in_place()) save_resumed_state();
  if (start_) save_start();
  if (resumed_) make_resumed_trainer();
  last_checkpoint_.emplace(*checkpoints_, trainer_->schedule().steps());
  trainer_->keep_checkpoints_in(*last_checkpoint_);
  add_observers();
  clock_.end("preparation");

  train();
  save_last_model();
  const bool is_stopped = trainer_->step() < trainer_->schedule().steps();
  if (!is_stopped) finish();
  observers_->lost.say_again();
  return is_stopped ? SessionEnd::stopped : SessionEnd::finished;
}

// Another process than 0: it takes the same steps of the same run, and writes nothing.
SessionEnd TrainSession::follow() {
  choose_run(CheckpointPart::whole);
  if (is_finished()) return SessionEnd::nothing_left;
  hooks_.use_threads(config_.train.threads);
  start_backend();
  get_scene();
  if (resumed_)
    make_resumed_trainer();
  else
    make_new_trainer();
  trainer_->run();
  return SessionEnd::finished;
}

void TrainSession::add_observers() {
  const RowsBefore rows = rows_before(resumed_, trainer_->step(), trainer_->schedule().steps());
  observers_ = std::make_unique<Observers>(*folder_, *trainer_, request_.shows_progress, rows);
  hooks_.before_training(*trainer_, observers_->metrics, observers_->evaluations);
}

void TrainSession::train() {
  std::optional<StopOnSignal> stop_on_signal;
  if (request_.stops_on_signal) stop_on_signal.emplace(*trainer_);
  const double before = trainer_->train_seconds();
  naming_what_is_kept([&] { trainer_->run(); });
  observers_->progress.clear();
  clock_.end("training", trainer_->train_seconds() - before);
  clock_.end("between steps");
}

void TrainSession::save_last_model() {
  const int last = trainer_->step();
  const bool is_last_step = last == trainer_->schedule().steps();
  save_poses(*folder_, *trainer_);
  if (!is_last_step && fs::exists(folder_->ply(last))) return;  // train.save_steps named the step
  if (is_last_step)
    guarded("saving the model", [&] { write_last_model(); });
  else
    guarded("saving the model", [&] { save_model(*folder_, last, *trainer_); });
  if (const auto looks = looks_of(*trainer_)) write_photometric(folder_->photometric(), *looks);
  clock_.end("copy of the model");
}

void TrainSession::write_last_model() {
  if (config_.model.filter_3d)
    write_gaussian_ply(folder_->raw_ply(trainer_->step()), raw_model(*trainer_));
  last_model_ = trained_model(*trainer_);
  model_file_ = in_background(
      [this, file = folder_->ply(trainer_->step())] { write_gaussian_ply(file, *last_model_); });
}

void TrainSession::end_part(const char* part) {
  clock_.end(part);
  results_.wall_seconds = clock_.parts();
}

void TrainSession::wait_for_files() {
  last_checkpoint_->wait();
  model_file_.get();
}

void TrainSession::finish() {
  results_ = results_of(*trainer_);
  results_.scene_hash = scene_hash_;
  log_info("all {} steps are done, and the model is being saved; now it is evaluated",
           results_.iterations);
  ShownViews pictures;
  guarded("the evaluation", [&] {
    pictures = evaluate_run(
        *trainer_, *folder_, lpips_.get(), results_,
        [&](std::size_t done, std::size_t total) { hooks_.show_evaluation(done, total); });
  });
  observers_->metrics.finish(results_.iterations, *trainer_, results_.test);
  write_text(folder_->per_view(), per_view_json(results_));
  end_part("evaluation");
  if (request_.writes_report)
    write_final_report(*folder_,
                       {results_json(results_), results_.iterations, *last_model_, pictures});
  end_part("report");
  naming_what_is_kept([&] { wait_for_files(); });
  end_part("files");
  write_text(folder_->results(), results_json(results_));  // last: it says that the run is finished
  checkpoints_->keep_only_newest();
  // From here on the run is saved, and nothing can be lost.
  guarded("the COLMAP model of refined poses", [&] { save_refined_model(*folder_, *trainer_); });
  guarded("an export", [&] { export_run(request_.exports, *folder_, *trainer_); });
}

// Writes exports that a kill after results.json, or an older command without them, has left out.
SessionEnd TrainSession::end_finished_run() {
  log_info("the run in {} is finished, and exports are missing: they are written now",
           resumed_->source.string());
  trainer_.emplace(*scene_, config_, *backend_, std::move(resumed_->checkpoint.state));
  trainer_->run();  // no step is left: only the model is made ready, as it was saved
  trainer_->guarded("an export", [&] {
    export_run(missing_exports(request_.exports, *folder_), *folder_, *trainer_);
  });
  return SessionEnd::nothing_left;
}

void TrainSession::guarded(const char* what, const std::function<void()>& f) {
  naming_what_is_kept([&] { trainer_->guarded(what, f); });
}

// Runs f(). An error also says what is saved, and how to go on.
void TrainSession::naming_what_is_kept(const std::function<void()>& f) {
  try {
    f();
  } catch (const Error& error) {
    if (last_checkpoint_) last_checkpoint_->wait();  // so that the message can name them
    if (model_file_.valid()) model_file_.wait();
    observers_->progress.clear();
    observers_->lost.say_again();
    throw Error(error.what() + what_is_kept(error.code()), error.code());
  }
}

// Part of the message of another failure, which counts more than one here.
std::string TrainSession::what_is_kept(ExitCode code) const {
  std::string text;
  try {
    add_what_is_kept(text, code);
  } catch (const Error&) {
  } catch (const fs::filesystem_error&) {
  }
  return text;
}

void TrainSession::add_what_is_kept(std::string& text, ExitCode code) const {
  const int last = trainer_->step();
  if (fs::exists(folder_->ply(last)))
    text += fmt::format("; the model is in {}", folder_->ply(last).string());
  if (const auto kept = checkpoints_in(folder_->checkpoints()); !kept.empty())
    text += fmt::format("; the checkpoint of step {} is in {}: go on with --resume{}", kept[0].step,
                        kept[0].file.string(),
                        code == ExitCode::out_of_memory
                            ? " and a lower --max-gaussians, or on another machine"
                            : "");
}

}  // namespace gs
