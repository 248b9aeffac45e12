// SPDX-License-Identifier: Apache-2.0
#include "gs_train/trainer.h"

#include <spdlog/fmt/fmt.h>

#include <chrono>
#include <cmath>

#include "gs_core/error.h"
#include "gs_core/math/activations.h"
#include "gs_train/floaters.h"
#include "gs_train/gaussian_budget.h"
#include "gs_train/initialize.h"

namespace gs {
namespace {

constexpr double kGib = 1024.0 * 1024.0 * 1024.0;  // bytes

double seconds_now() {
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

const Scene& with_views(const Scene& scene) {
  if (scene.train_views.empty())
    throw Error("there is no view to train on in " + scene.source +
                "; hold out fewer views (--test-every) or check the reconstruction");
  return scene;
}

// What the run found out that there is memory for stays, whatever is free now.
Config with_known_cap(Config config, const RunProgress& progress) {
  if (config.density.max_gaussians == kAutoCount && progress.growth_cap > 0)
    config.density.max_gaussians = progress.growth_cap;
  return config;
}

std::vector<std::uint32_t> visible_rows(const Gaussians& gaussians) {
  std::vector<std::uint32_t> rows;
  for (std::uint32_t i = 0; i < gaussians.count(); ++i)
    if (!(sigmoid(gaussians.logit_opacity[i]) < kMinAlpha)) rows.push_back(i);
  return rows;
}

}  // namespace

RenderSettings render_settings(const Config& config) {
  RenderSettings settings;
  settings.sh_degree = config.model.sh_degree;
  settings.truncation = config.render.truncation == "sigma2"   ? Truncation::sigma2
                        : config.render.truncation == "sigma3" ? Truncation::sigma3
                        : config.render.truncation == "sigma4" ? Truncation::sigma4
                                                               : Truncation::alpha;
  settings.bounds = config.render.bounds == "box"      ? TileBounds::box
                    : config.render.bounds == "square" ? TileBounds::square
                                                       : TileBounds::exact;
  settings.use_tensor_cores = config.render.blend == "gemm";
  settings.half_precision = config.render.precision == "half";
  settings.deterministic = config.train.deterministic;
  settings.blend_rule =
      config.render.blend_rule == "classic" ? BlendRule::classic : BlendRule::faster_gs;
  settings.antialias = config.render.antialias;
  settings.antialias_detach = config.render.antialias_detach;
  settings.absolute_gradient = config.density.absolute_gradient;
  settings.near_plane = config.render.near_plane;
  settings.far_plane = config.render.far_plane;
  if (config.render.background == "white") settings.background = Vec3f(1.0f);
  return settings;
}

Trainer::Trainer(const Scene& scene, const Config& config, Backend& backend, TrainingModel model)
    : scene_(with_views(scene)), config_(config), backend_(backend),
      schedule_(config, scene.extent), settings_(render_settings(config)),
      views_(scene.train_views.size(), config.train.seed), views_ahead_(views_),
      model_(std::move(model)), checkpoint_timer_(config.train.checkpoint_every),
      guard_(scene.train_views.size()) {
  settings_.sh_degree = 0;  // raised by the schedule
  backend_.upload_views(scene.train_views, std::size_t(double(config.train.photo_gib) * kGib));
  const bool is_found_out = config_.density.max_gaussians == kAutoCount;
  if (is_found_out)
    config_.density.max_gaussians = affordable_gaussians(scene, model_, backend_.memory());
  density_ = make_density_control(config_, schedule_, scene.extent);
  if (is_found_out)  // once and for all: checkpoints keep it
    density_->set_growth_cap(config_.density.max_gaussians);
}

Trainer::Trainer(const Scene& scene, const Config& config, Backend& backend)
    : Trainer(scene, config, backend, initial_model(with_views(scene), config, backend.memory())) {}

Trainer::Trainer(const Scene& scene, const Config& config, Backend& backend, TrainingState from)
    : Trainer(scene, with_known_cap(config, from.progress), backend,
              TrainingModel(backend.memory())) {
  if (from.progress.strikes.size() != scene.train_views.size())
    throw Error(scene.source +
                " has another number of training views than the run had; train on "
                "the scene of the run");
  guard_.restore(from.progress.strikes);
  restore(std::move(from));
  first_step_ = step_ + 1;
}

template <class F>
auto Trainer::timed(F&& f) {
  const double begin = seconds_now();
  auto result = f();
  train_seconds_ += seconds_now() - begin;
  return result;
}

void Trainer::notify(const std::function<void(Observer&)>& f) {
  for (Observer* observer : observers_)
    if (!with_room("looking on", [&] { f(*observer); }))
      throw Error(memory_trouble_, ExitCode::out_of_memory);
}

const TrainingModel& Trainer::model() {
  return *timed([&] {
    backend_.synchronize(model_);
    return &model_;
  });
}

void Trainer::look_at_result(const std::function<void(const Gaussians&)>& f) {
  model();
  const HiddenFloaters hidden(model_, clear_space());
  f(model_.gaussians);
}

const ClearSpace& Trainer::clear_space() {
  if (!clear_space_) clear_space_.emplace(scene_, config_.density.camera_clearance);
  return *clear_space_;
}

double Trainer::loss() {
  if (step_ < first_step_) return restored_loss_;
  const double loss = timed([&] { return backend_.loss().value(); });
  if (!std::isfinite(loss)) breakdown_ = "the loss is not a number";
  return loss;
}

void Trainer::run() {
  begin();
  for (bool is_over = step_ >= schedule_.steps(); !is_over;) {
    timed([&] { return take_step(step_ + 1), 0; });
    const bool is_last = step_ == schedule_.steps(), is_stopped = stop_requested_;
    if (breakdown_.empty() && !is_last)
      notify([&](Observer& observer) { observer.after_step(step_, *this); });
    if (breakdown_.empty() && wants_checkpoint(is_last, is_stopped)) keep_checkpoint();
    if (!breakdown_.empty()) roll_back();
    is_over = step_ == schedule_.steps() || is_stopped;
  }
  timed([&] { return finish(), 0; });
  if (step_ == schedule_.steps())
    notify([&](Observer& observer) { observer.after_step(step_, *this); });
  notify([&](Observer& observer) { observer.after_run(*this); });
}

bool Trainer::wants_checkpoint(bool is_last, bool is_stopped) const {
  return is_stopped || (is_last && config_.train.checkpoint_every >= 0) ||
         checkpoint_timer_.due(step_);
}

void Trainer::begin() {
  expect_views_from(step_ + 1, step_ + int(kPhotosAhead));
  if (step_ == 0)
    if_there_is_room("the Morton order", [&] { backend_.rows().sort_by_morton(model_); });
}

void Trainer::take_step(int step) {
  if (!with_room("a step", [&] { one_step(step); }))
    throw Error(fmt::format("{}; step {} cannot be taken even after all that can be given back",
                            memory_trouble_, step),
                ExitCode::out_of_memory);
  step_ = step;
  expect_views_from(step + int(kPhotosAhead), step + int(kPhotosAhead));
  if (guard_.is_watching(step)) look_at_model();
  if (breakdown_.empty()) control_density(step);
  if (breakdown_.empty()) maintain(step);
}

void Trainer::one_step(int step) {
  const View& view = view_of(views_, step);
  if (config_.render.background == "random") settings_.background = random_background(step);
  backend_.prefetch_next(view_of(views_, step + 1));
  // Render, compare, differentiate, update               3DGS Eq. 3-7; Faster-GS Sec. "Optimization"
  backend_.step(model_, view, settings_, config_.loss.lambda_dssim, schedule_.learning_rates(step),
                density_->of_step(step));
}

// Clone, split, prune, reset: 3DGS Sec. 5.2; or relocate and grow: MCMC
void Trainer::control_density(int step) {
  const bool refines = schedule_.refine(step);
  if (refines && !is_sound()) return;
  if_there_is_room("density control", [&] { density_->after_step(model_, backend_, step); });
  if (refines && model_.count() == 0) {
    breakdown_ = "no Gaussian is left";
    blames_view_ = false;
  }
}

// Unlock SH bands; keep neighbors adjacent in memory
void Trainer::maintain(int step) {
  if (schedule_.raise_sh_degree(step) && settings_.sh_degree < config_.model.sh_degree)
    ++settings_.sh_degree;
  if (schedule_.reorder(step))
    if_there_is_room("the Morton order", [&] { backend_.rows().sort_by_morton(model_); });
}

const View& Trainer::view_of(ViewSampler& views, int step) {
  return scene_.train_views[guard_.instead_of(views.view_of(step))];
}

void Trainer::expect_views_from(int first, int last) {
  for (int step = first; step <= std::min(last, schedule_.steps()); ++step)
    backend_.prefetch_decode(view_of(views_ahead_, step));
}

void Trainer::finish() {
  is_finishing_ = true;  // from here on the model is a result, and no state to go on from
  backend_.synchronize(model_);
  if_there_is_room("the final prune", [&] {
    HiddenFloaters(model_, clear_space()).leave();
    backend_.rows().prune(model_, kMinAlpha);
  });
  if_there_is_room("the Morton order", [&] { backend_.rows().sort_by_morton(model_); });
}

Vec3f Trainer::random_background(int step) const {
  const Vec4f u =
      Random{config_.train.seed, RandomStream::background}.uniform4(std::uint64_t(step));
  return {u.x, u.y, u.z};
}

RenderSettings Trainer::evaluation_settings() const {
  RenderSettings settings = render_settings(config_);
  settings.sh_degree = settings_.sh_degree;
  settings.for_backward = false;
  return settings;
}

GaussianModel copied_model(Trainer& trainer) {
  GaussianModel model;
  trainer.look_at_result([&](const Gaussians& gaussians) {
    model = host_copy(gaussians, trainer.config().model.sh_degree, trainer.settings().antialias);
  });
  model.world_offset = trainer.scene().world_offset;
  return model;
}

GaussianModel visible_part(const GaussianModel& model) {
  return {rows_of(model.gaussians, visible_rows(model.gaussians)), model.sh_degree, model.is_ours,
          model.antialiased, model.world_offset};
}

GaussianModel trained_model(Trainer& trainer) { return visible_part(copied_model(trainer)); }

}  // namespace gs
