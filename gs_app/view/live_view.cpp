// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/live_view.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <new>

#include "data_loaders/formats/formats.h"
#include "gs_app/view/low_priority.h"
#include "gs_app/view/served_model.h"
#include "gs_core/error.h"
#include "gs_core/io/scratch_folder.h"
#include "gs_core/log.h"
#include "gs_core/parallel.h"
#include "gs_render/render_settings.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

// Of the formats that the page reads the quickest to write, and with all SH: docs/viewer.md.
constexpr const char* kSnapshotFormat = "compressed.ply";

Json json_of(const std::optional<double>& value) { return value ? Json(*value) : Json(); }

ViewScene live_scene(std::string title, const Scene& scene, const Config& config) {
  ViewScene live;
  live.title = std::move(title);
  take_settings(live, render_settings(config));
  live.cameras = viewed_cameras(scene);
  std::vector<Vec3f> points;
  for (const ScenePoint& point : scene.points) points.push_back(point.position);
  live.frame = frame_of(live.cameras, {points.data(), points.size()});
  return live;
}

// A run does not give up caches, let alone end, for those who watch.
std::optional<GaussianModel> copy_if_there_is_room(Trainer& trainer) {
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
                   LookBudget::Clock clock)
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
  take_figures(step, trainer);
  {
    const std::lock_guard lock(mutex_);
    if (is_encoding_) return;
  }
  if (!budget_.may_look()) return;
  trainer.model();  // the steps under way are training's own time
  std::optional<GaussianModel> copy;
  budget_.look([&] { copy = copy_if_there_is_room(trainer); });
  if (!copy) {
    const std::lock_guard lock(mutex_);
    figures_.message = "no snapshot: there is too little memory for a copy of the model";
    figures_.message_until = step;
    return;
  }
  copy->sh_degree = std::min(copy->sh_degree, trainer.settings().sh_degree);  // what is in use so far
  ++looks_;
  hand_over(std::move(*copy));
}

void LiveView::after_rollback(int step, Trainer&) {
  const std::lock_guard lock(mutex_);
  figures_.message = fmt::format("the run went back to the state after step {}", step);
  figures_.message_until = figures_.step;
  figures_.step = step;
}

void LiveView::after_run(Trainer& trainer) {
  const std::lock_guard lock(mutex_);
  figures_.is_stopped = trainer.step() < trainer.schedule().steps();
}

// What is known without a wait for the device.
void LiveView::take_figures(int step, Trainer& trainer) {
  const std::lock_guard lock(mutex_);
  figures_.step = step;
  figures_.steps = trainer.schedule().steps();
  figures_.gaussians = trainer.gaussian_count();
  figures_.seconds = trainer.train_seconds();
  if (metrics_) figures_.loss = metrics_->last_loss();
  if (const Evaluation* found = evaluations_ ? evaluations_->at(step) : nullptr)
    figures_.psnr = found->psnr;
  if (step > figures_.message_until) figures_.message.clear();
}

void LiveView::end(std::optional<GaussianModel> model, const Evaluation& test) {
  if (model) hand_over(std::move(*model));
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return !is_encoding_; });
  if (!test.views.empty()) figures_.psnr = test.psnr;
  figures_.is_done = true;
}

void LiveView::hand_over(GaussianModel model) {
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
      trouble = error.what();
      log_warning("no snapshot for the viewer: {}", trouble);
    }
    lock.lock();
    if (trouble.empty()) {
      newest_ = std::move(snapshot);
      ++version_;
    } else {
      figures_.message = trouble;
      figures_.message_until = figures_.steps;
    }
    is_encoding_ = false;
    changed_.notify_all();
  }
}

LiveView::Snapshot LiveView::encode(const GaussianModel& model) const {
  const GaussianModel visible = visible_part(model);
  const ModelFormat& format = format_named(kSnapshotFormat);
  const ScratchFolder scratch;
  const std::filesystem::path path = scratch.path() / ("snapshot" + std::string(format.ending));
  const std::size_t written = write_model(path, visible);
  std::ifstream file(path, std::ios::binary);
  auto bytes = std::make_shared<std::string>(std::istreambuf_iterator<char>(file),
                                             std::istreambuf_iterator<char>());
  if (bytes->size() != std::filesystem::file_size(path))
    throw Error("cannot read " + path.string() + " back");
  return {std::move(bytes), written, model.sh_degree, model.antialiased};
}

Json LiveView::mode_and_model() {
  const std::lock_guard lock(mutex_);
  Json json = {{"mode", "live"}};
  if (version_ > 0)
    json["model"] =
        model_json(format_named(kSnapshotFormat), fmt::format("snapshot {}", version_),
                   newest_.gaussians, newest_.file->size(), newest_.sh_degree, newest_.antialiased);
  return json;
}

Json LiveView::state() {
  budget_.watch();
  const std::lock_guard lock(mutex_);
  return {{"step", figures_.step},
          {"steps", figures_.steps},
          {"loss", json_of(figures_.loss)},
          {"gaussians", figures_.gaussians},
          {"psnr", json_of(figures_.psnr)},
          {"seconds", figures_.seconds},
          {"version", version_},
          {"done", figures_.is_done},
          {"stopped", figures_.is_stopped},
          {"message", figures_.message}};
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
