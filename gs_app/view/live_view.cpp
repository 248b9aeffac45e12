// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/live_view.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <limits>
#include <new>

#include "gs_app/view/served_model.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/plain_message.h"
#include "gs_core/threads/low_priority.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/formats/formats.h"
#include "gs_render/render_settings.h"
#include "gs_train/poses/poses.h"

namespace gs {
namespace {

// The fastest to write of the formats that the page reads and that keep all SH coefficients:
// docs/reference/viewer.md has times.
const ModelFormat& snapshot_format(bool has_time) {
  return format_named(has_time ? "gs4d" : "compressed.ply");
}

constexpr std::size_t kMostLosses = 2000;  // in one answer: more than the page's chart has pixels

Json json_of(const std::optional<double>& value) { return value ? Json(*value) : Json(); }

// [[step, loss], ...] after a step: every n-th if there are more than kMostLosses, and always the
// last.
Json losses_json(const std::vector<LoggedLoss>& losses, int after_step) {
  const auto first =
      std::partition_point(losses.begin(), losses.end(),
                           [&](const LoggedLoss& logged) { return logged.step <= after_step; });
  const auto count = std::size_t(losses.end() - first), stride = count / kMostLosses + 1;
  Json list = Json::array();
  for (std::size_t i = 0; i < count; ++i)
    if (i % stride == 0 || i + 1 == count) list.push_back({first[i].step, first[i].loss});
  return list;
}

ViewScene live_scene(std::string title, const Scene& scene, const Config& config) {
  ViewScene live;
  live.title = std::move(title);
  live.path = config.model.output;
  take_settings(live, render_settings(config));
  live.world_offset = scene.world_offset;
  take_meters(live, config.dataset.source, 1);
  live.moves = config.model.dynamic;
  live.cameras = viewed_cameras(scene);
  std::vector<Vec3f> points;
  for (const ScenePoint& point : scene.points) points.push_back(point.position);
  live.frame = frame_of(live.cameras, {points.data(), points.size()});
  return live;
}

// A copy of the model, or nothing if there is too little memory for it: a run neither drops caches
// nor ends for the sake of the viewer.
std::optional<GaussianModel> copy_if_it_fits(Trainer& trainer) {
  try {
    return copied_model(trainer);
  } catch (const std::bad_alloc&) {
    return {};
  } catch (const Error& error) {
    if (error.code() != ExitCode::out_of_memory) throw;
    return {};
  }
}

}  // namespace

LiveView::LiveView(std::string title, const Scene& scene, const Config& config,
                   SnapshotBudget::Clock clock)
    : scene_(live_scene(std::move(title), scene, config)), budget_(std::move(clock)),
      encoder_([this] { encode_all(); }) {}

LiveView::~LiveView() {
  {
    const std::lock_guard lock(mutex_);
    quit_ = true;
  }
  changed_.notify_all();
  encoder_.join();
}

void LiveView::follow(const MetricsObserver& metrics, const EvaluationObserver& evaluations) {
  metrics_ = &metrics;
  evaluations_ = &evaluations;
}

void LiveView::after_step(int step, Trainer& trainer) {
  update_progress(step, trainer);
  {
    const std::lock_guard lock(mutex_);
    if (is_encoding_) return;
  }
  if (!budget_.allows_copy()) return;
  trainer.model();  // waits for the steps under way, which are not part of the copy's cost
  take_snapshot(trainer);
}

void LiveView::show_now(Trainer& trainer) { take_snapshot(trainer); }

void LiveView::take_snapshot(Trainer& trainer) {
  std::optional<GaussianModel> copy;
  budget_.spend([&] { copy = copy_if_it_fits(trainer); });
  if (!copy) {
    const std::lock_guard lock(mutex_);
    progress_.message = "no snapshot: there is too little memory for a copy of the model";
    progress_.message_until = trainer.step();
    return;
  }
  // The degree in use so far.
  copy->sh_degree = std::min(copy->sh_degree, trainer.settings().sh_degree);
  ++copies_;
  take_poses(trainer);
  pass_to_encoder(std::move(*copy));
}

void LiveView::take_poses(Trainer& trainer) {
  const PoseState& poses = trainer.model().poses;
  if (poses.empty()) return;
  const std::lock_guard lock(mutex_);
  refined_ = refined_cameras(poses, trainer.scene().train_views);
}

void LiveView::after_rollback(int step, Trainer&) {
  const std::lock_guard lock(mutex_);
  progress_.message = fmt::format("the run went back to the state after step {}", step);
  progress_.message_until = progress_.step;
  progress_.step = step;
  update_losses();
}

void LiveView::after_run(Trainer& trainer) {
  take_poses(trainer);
  const std::lock_guard lock(mutex_);
  progress_.is_stopped = trainer.step() < trainer.schedule().steps();
}

// Takes only what is known without waiting for the device.
void LiveView::update_progress(int step, Trainer& trainer) {
  const std::lock_guard lock(mutex_);
  progress_.step = step;
  progress_.steps = trainer.schedule().steps();
  progress_.gaussians = trainer.gaussian_count();
  progress_.seconds = trainer.train_seconds();
  update_losses();
  if (const Evaluation* found = evaluations_ ? evaluations_->at(step) : nullptr)
    progress_.psnr = found->psnr;
  if (step > progress_.message_until) progress_.message.clear();
}

// Follows metrics.csv, of which a run that goes back to a checkpoint drops rows.
void LiveView::update_losses() {
  if (!metrics_) return;
  const std::vector<LoggedLoss>& logged = metrics_->losses();
  std::vector<LoggedLoss>& losses = progress_.losses;
  losses.resize(std::min(losses.size(), logged.size()));
  losses.insert(losses.end(), logged.begin() + std::ptrdiff_t(losses.size()), logged.end());
}

void LiveView::say(std::string sentence) {
  const std::lock_guard lock(mutex_);
  progress_.message = std::move(sentence);
  progress_.message_until = std::numeric_limits<int>::max();
}

void LiveView::end(std::optional<GaussianModel> model, const Evaluation& test) {
  if (model) pass_to_encoder(std::move(*model));
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return !is_encoding_; });
  if (!test.views.empty()) progress_.psnr = test.psnr;
  progress_.is_done = true;
}

void LiveView::pass_to_encoder(GaussianModel model) {
  {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return !is_encoding_; });
    waiting_ = std::move(model);
    is_encoding_ = true;
  }
  changed_.notify_all();
}

void LiveView::encode_all() {
  const SerialLoops beside_training;
  lower_priority_once();
  for (std::unique_lock lock(mutex_);;) {
    changed_.wait(lock, [&] { return quit_ || waiting_; });
    if (quit_) return;
    const GaussianModel model = std::move(*waiting_);
    waiting_.reset();
    lock.unlock();
    Snapshot snapshot;
    std::string trouble;
    try {
      snapshot = encode(model);
    } catch (const std::exception& error) {
      trouble = plain_message(error);
      log_warning("no snapshot for the viewer: {}", trouble);
    }
    lock.lock();
    if (trouble.empty()) {
      newest_ = std::move(snapshot);
      ++version_;
    } else {
      progress_.message = trouble;
      progress_.message_until = progress_.steps;
    }
    is_encoding_ = false;
    changed_.notify_all();
  }
}

LiveView::Snapshot LiveView::encode(const GaussianModel& model) const {
  const GaussianModel visible = visible_part(model);
  const ModelFormat& format = snapshot_format(model.gaussians.has_time);
  MemorySink sink("the snapshot");
  const std::size_t written = write_model(sink, format, visible);
  return {std::make_shared<std::string>(std::move(sink.text)), written, model.sh_degree,
          model.antialiased};
}

Json LiveView::mode_and_model() {
  const std::lock_guard lock(mutex_);
  Json json = {{"mode", "live"}};
  if (!refined_.empty()) {  // test views come first in viewed_cameras()
    std::vector<ViewedCamera> cameras = scene_.cameras;
    const std::size_t first = cameras.size() - refined_.size();
    for (std::size_t i = 0; i < refined_.size(); ++i) cameras[first + i].camera = refined_[i];
    json["cameras"] = cameras_json(cameras);
  }
  if (version_ > 0)
    json["model"] =
        model_json(snapshot_format(scene_.moves), fmt::format("snapshot {}", version_),
                   newest_.gaussians, newest_.file->size(), newest_.sh_degree, newest_.antialiased);
  return json;
}

Json LiveView::state(int after_step) {
  budget_.note_poll();
  RunControl* const run = control_;
  const Json control = run ? run->state() : Json();
  const std::lock_guard lock(mutex_);
  const std::vector<LoggedLoss>& losses = progress_.losses;
  return {{"step", progress_.step},
          {"steps", progress_.steps},
          {"loss", losses.empty() ? Json() : Json(losses.back().loss)},
          {"losses", losses_json(losses, after_step)},
          {"gaussians", progress_.gaussians},
          {"psnr", json_of(progress_.psnr)},
          {"seconds", progress_.seconds},
          {"version", version_},
          {"done", progress_.is_done},
          {"stopped", progress_.is_stopped},
          {"message", progress_.message},
          {"control", control}};
}

HttpAnswer LiveView::control(const HttpRequest& request) {
  RunControl* const run = control_;
  return run ? run->answer(request) : ViewSource::control(request);
}

HttpAnswer LiveView::model() {
  const std::lock_guard lock(mutex_);
  if (version_ == 0) return http_error(404, "there is no snapshot yet");
  HttpAnswer answer;
  answer.type = "application/octet-stream";
  answer.body = newest_.file;
  return answer;
}

}  // namespace gs
