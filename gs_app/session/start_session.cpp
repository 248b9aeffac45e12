// SPDX-License-Identifier: Apache-2.0
// What a TrainSession does before its first step: it finds the run to resume, the folder, the scene
// and the device, and makes the trainer.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <string>

#include "data_loaders/scene/scene_hash.h"
#include "data_loaders/scene/scene_model.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/session/load_run_scene.h"
#include "gs_app/session/start_model.h"
#include "gs_app/session/train_session.h"
#include "gs_core/config/scene_settings.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/threads/parallel.h"
#include "gs_core/threads/start_threads.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

std::string absolute_path(const std::string& path) {
  return path.empty() ? path : fs::absolute(path).lexically_normal().string();
}

void advise_on_panoramas(const Config& config, const Scene& scene) {
  const bool has_panorama =
      std::ranges::any_of(scene.train_views, [](const View& view) { return bool(view.panorama); });
  if (has_panorama && !config.model.filter_3d && !config.model.dynamic)
    log_info(
        "viewers show more pixels a degree than panoramas have; --filter-3d --antialiased keep the "
        "model from looking thin and dark there");
}

}  // namespace

void TrainSession::choose_run(CheckpointPart part) {
  resumed_.reset();  // one checkpoint in memory at a time
  if (!request_.resume.empty())
    resumed_ = find_resumed_run(request_.settings, request_.resume, request_.added_steps, part);
  config_ = resumed_ ? resumed_->config : config_of_new_run();
  if (config_.eval.lpips != "none") config_.eval.lpips = absolute_path(config_.eval.lpips);
}

// The settings of a new run. Paths are made absolute, so that the run's folder can be used from
// anywhere.
Config TrainSession::config_of_new_run() const {
  Config config = request_.settings({});
  if (!request_.scene && config.dataset.source.empty())
    throw UsageError("there is no scene; give its folder: gemsplat train SCENE -o OUT");
  if (config.model.output.empty())
    throw UsageError("there is no output; give the folder of the run with -o OUT");
  config.dataset.source = absolute_path(config.dataset.source);
  config.dataset.photo_list = absolute_path(config.dataset.photo_list);
  config.model.start_from = absolute_path(config.model.start_from);
  return config;
}

// What must stay where it is while the run's folder is made.
std::vector<fs::path> TrainSession::inputs() const {
  std::vector<fs::path> inputs = inputs_of(config_);
  if (resumed_) inputs.push_back(resumed_->source);
  return inputs;
}

// The settings, which name the folder, follow from the head of a checkpoint. Its arrays are read once
// no other process changes the folder any more.
void TrainSession::lock_folder() {
  try {
    choose_run(CheckpointPart::head);
  } catch (const Error&) {
    choose_run(CheckpointPart::whole);  // throws again, unless the head was damaged
  }
  folder_.emplace(config_.model.output);
  check_is_folder(*folder_);
  lock_.emplace(OutputLock::of_folder(folder_->root()));
  choose_run(CheckpointPart::whole);
}

void TrainSession::check_output() const {
  to_toml(config_);  // throws where the paths cannot be written down
  if (!(resumed_ ? goes_on_in_place() : !request_.resume.empty()))
    check_is_free(*folder_, request_.force, inputs());
}

// A run that --force replaces moves away with the scene that was made of its photos. One that was
// killed before its first checkpoint keeps it, since COLMAP may have worked for hours.
void TrainSession::clear_folder_for_photos() {
  if (request_.resume.empty())
    move_run_aside(*folder_, *lock_, inputs());
  else
    move_trained_run_aside(*folder_, *lock_, inputs());
}

// A GPU takes a quarter of a second to open, in which the scene is read.
void TrainSession::start_backend() {
  if (request_.place && config_.photometric.model == kAutoPhotometricModel)
    throw UsageError(
        "photometric.model = auto may come out differently in each process; name a model where "
        "several train");
  backend_is_made_ = in_background(
      [this, train = config_.train, place = request_.place, output = config_.model.output] {
        backend_ = make_training_backend(train, place ? &*place : nullptr, output);
      });
}

// Waits for it. A photo is drawn by one GPU.
void TrainSession::take_backend() {
  if (!backend_is_made_.valid()) return;
  backend_is_made_.get();
  backend_->device().make_current();  // for this thread
  log_info("training on {} with {} threads", backend_->name(), thread_count());
  const TrainConfig& train = config_.train;
  const int gpus = train.ranks * (request_.place ? request_.place->count : 1);
  if (const int most = std::min(gpus, kMostBatch); train.batch < most)
    log_warning(
        "train.batch is {}, so that {} of {} GPUs wait while photos are drawn; a new run with "
        "--set train.batch={} keeps all of them busy",
        train.batch, gpus - train.batch, gpus, most);
}

void TrainSession::get_scene() {
  scene_ = request_.scene;
  if (!scene_ && !resumed_ && folder_)
    has_made_scene_ = reconstruct_bare_photos(
        config_, *folder_,
        [&] {
          take_backend();
          clear_folder_for_photos();
        },
        hooks_);
  describe_scene();
  if (!scene_) scene_ = &loaded_scene_.emplace(load_run_scene(config_, hooks_));
  take_backend();
  advise_on_panoramas(config_, *scene_);
  choose_photometric_model(config_, *scene_);
  if (lpips_)
    lpips_->check_sizes(scene_->test_views.empty() ? scene_->train_views : scene_->test_views);
  if (!resumed_) config_ = resolved_config(config_, *scene_);
  if (config_.model.start_from.empty()) log_forecast(config_, *scene_, *backend_, 0);
  record_scene();
  if (!resumed_) return;
  check_same_scene(*resumed_, record_, scene_->source);
  if (!loaded_scene_ && !has_solved_views(*resumed_)) return;  // nothing of it would change
  if (!loaded_scene_) scene_ = &loaded_scene_.emplace(*scene_);
  restore_scene(*resumed_, *loaded_scene_);
}

// Before the scene is read and not after training, which may take a day: then it describes what is
// trained on, and nothing is lost if the scene's disk is unplugged meanwhile.
void TrainSession::describe_scene() {
  if (config_.dataset.source.empty()) return;  // a scene made of arrays
  try {
    scene_hash_ = scene_hash(config_.dataset);
  } catch (const Error&) {
    if (!request_.scene) throw;  // else its files may be gone already
  }
}

void TrainSession::record_scene() {
  record_ = SceneRecord(*scene_);
  if (scene_hash_.empty()) return;
  std::vector<std::string> names;
  for (const ViewRecord& view : record_.views) names.push_back(view.name);
  const std::vector<std::uint64_t> photos = photo_hashes(config_.dataset, names);
  for (std::size_t i = 0; i < photos.size(); ++i) record_.views[i].photo = photos[i];
}

void TrainSession::make_new_trainer() {
  if (config_.model.start_from.empty()) {
    if (scene_->points.empty()) log_warning("{}", text_of_no_points(config_.model.random_points));
    trainer_.emplace(*scene_, config_, *backend_);
    return;
  }
  TrainingState state = state_from_model(config_, *scene_);
  log_forecast(config_, *scene_, *backend_, state.model.count());
  start_ = state.progress;
  trainer_.emplace(*scene_, config_, *backend_, std::move(state));
  if (config_.density.max_gaussians == kAutoCount)
    start_->growth_cap = trainer_->config().density.max_gaussians;
}

// Makes the folder that the run is written to, and writes what is known before the first step.
void TrainSession::start_folder() {
  if (goes_on_in_place()) {
    prepare_resumed_folder(*folder_, *resumed_);
    if (holds_text(folder_->config(), to_toml(config_))) return;  // so the other files fit as well
  } else if (!resumed_ && !request_.resume.empty()) {
    prepare_fresh_start(*folder_, config_, *lock_, inputs(), has_made_scene_);
  } else {
    move_run_aside(*folder_, *lock_, inputs());
  }
  write_run_description(*folder_, config_, *scene_);
}

void TrainSession::save_resumed_state() {
  checkpoints_->save(resumed_->checkpoint.state.progress, resumed_->checkpoint.state.model);
}

// A run that breaks down before its first checkpoint goes back to this one, and not to the scene's
// points.
void TrainSession::save_start() { checkpoints_->save(*start_, trainer_->model()); }

void TrainSession::make_resumed_trainer() {
  if (!config_.model.start_from.empty())  // what it has grown to by now
    log_forecast(config_, *scene_, *backend_, resumed_->checkpoint.state.model.count());
  if (resumed_->finishes_extension)
    log_info("the extension that was begun is finished first: {} extra steps in all",
             config_.train.extra_steps);
  log_info("the run goes on after step {}", resumed_->checkpoint.state.progress.step);
  trainer_.emplace(*scene_, config_, *backend_, std::move(resumed_->checkpoint.state));
}

}  // namespace gs
