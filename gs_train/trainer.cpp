// SPDX-License-Identifier: Apache-2.0
#include "gs_train/trainer.h"

#include <chrono>

#include "gs_core/error.h"
#include "gs_train/gaussian_budget.h"
#include "gs_train/initialise.h"

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

Trainer::Trainer(const Scene& scene, const Config& config, Backend& backend)
    : scene_(with_views(scene)), config_(config), backend_(backend),
      schedule_(config, scene.extent), settings_(render_settings(config)),
      views_(scene.train_views.size(), config.train.seed), views_ahead_(views_),
      model_(initial_model(scene, config, backend.memory())) {
  settings_.sh_degree = 0;  // raised by the schedule
  backend_.prepare(scene.train_views, std::size_t(double(config.train.photo_gib) * kGib));
  if (config_.density.max_gaussians == kAutoCount)
    config_.density.max_gaussians = affordable_gaussians(scene, model_, backend_.memory());
  density_ = make_density_control(config_, schedule_, scene.extent);
}

template <class F>
auto Trainer::timed(F&& f) {
  const double begin = seconds_now();
  auto result = f();
  train_seconds_ += seconds_now() - begin;
  return result;
}

const TrainingModel& Trainer::model() {
  return *timed([&] {
    backend_.settle(model_);
    return &model_;
  });
}

double Trainer::loss() {
  return timed([&] { return backend_.loss().value(); });
}

void Trainer::run() {
  double begin = seconds_now();
  const auto pause_for_observers = [&](auto&& notify) {
    train_seconds_ += seconds_now() - begin;
    for (Observer* observer : observers_) notify(*observer);
    begin = seconds_now();
  };

  for (int step = 1; step <= int(kPhotosAhead); ++step) expect_view_of(step);
  backend_.rows().sort_by_morton(model_);
  for (bool is_last = false; !is_last;) {
    one_step(++step_);
    is_last = step_ == schedule_.steps() || stop_requested_;
    if (is_last) finish();
    pause_for_observers([&](Observer& observer) { observer.after_step(step_, *this); });
  }
  pause_for_observers([&](Observer& observer) { observer.after_run(*this); });
}

void Trainer::one_step(int step) {
  const View& view = scene_.train_views[views_.view_of(step)];
  if (config_.render.background == "random") settings_.background = random_background(step);
  expect_view_of(step + int(kPhotosAhead));
  backend_.announce(scene_.train_views[views_.view_of(step + 1)]);
  // Render, compare, differentiate, update               3DGS Eq. 3-7; Faster-GS Sec. "Optimization"
  backend_.step(model_, view, settings_, config_.loss.lambda_dssim, schedule_.learning_rates(step),
                density_->of_step(step));
  // Control density: clone, split, prune, reset          3DGS Sec. 5.2, or MCMC
  density_->after_step(model_, backend_, step);
  // Keep house: unlock SH bands; keep neighbours adjacent in memory
  if (schedule_.raise_sh_degree(step) && settings_.sh_degree < config_.model.sh_degree)
    ++settings_.sh_degree;
  if (schedule_.reorder(step)) backend_.rows().sort_by_morton(model_);
}

void Trainer::expect_view_of(int step) {
  if (step <= schedule_.steps()) backend_.expect(scene_.train_views[views_ahead_.view_of(step)]);
}

void Trainer::finish() {
  backend_.rows().prune(model_, kMinAlpha);
  backend_.rows().sort_by_morton(model_);
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

}  // namespace gs
