// SPDX-License-Identifier: Apache-2.0
#include "gs_train/loop/trainer.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/bake_filter.h"
#include "gs_core/config/scene_settings.h"
#include "gs_core/config/text/region_text.h"
#include "gs_core/error.h"
#include "gs_core/forecast/training_memory.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/system/bytes.h"
#include "gs_core/system/log.h"
#include "gs_render/render_settings.h"
#include "gs_train/density/gaussian_budget.h"
#include "gs_train/initialize/initialize.h"
#include "gs_train/loop/neighbor_views.h"
#include "gs_train/photometric/photometric_start.h"
#include "gs_train/poses/poses.h"
#include "gs_train/row_rules.h"

namespace gs {
namespace {

constexpr double kShareOfFree = 0.9;  // that a model may take at once

// Takes memory for all Gaussians that a run on a GPU will have, so that its arrays neither grow
// step by step nor have anything in reserve. Where there is too little, they grow.
void reserve_rows(TrainingModel& model, const Config& config, const Memory& memory) {
  const auto count = std::size_t(config.density.max_gaussians);
  const TrainingSize size = training_size(config, {}, double(count));
  if (state_bytes(size, double(count)) > kShareOfFree * double(memory.free_bytes())) return;
  try {
    for (const Column& column : model.columns()) column.rows->reserve(count);
    if (size.has_sums) model.statistics.sums.reserve(count);  // the first step begins them
  } catch (const Error& error) {
    if (error.code() != ExitCode::out_of_memory) throw;
  }
}

const Scene& with_views(const Scene& scene) {
  if (scene.train_views.empty())
    throw Error("there is no view to train on in " + scene.source +
                "; hold out fewer views (--test-every) or check the reconstruction");
  return scene;
}

// Files of Gaussians are read above this library.
const Config& without_file(const Config& config) {
  if (config.model.start_from.empty()) return config;
  throw UsageError(
      "model.start_from is \"" + config.model.start_from +
      "\", and a Trainer by itself reads no file: train with a TrainSession, or give the Trainer "
      "state_from_model(config, scene), both of gs_app/session; or leave model.start_from empty");
}

void check_model(const Config& config) {
  if (config.model.filter_3d && config.model.dynamic)
    throw UsageError(
        "model.filter_3d is for scenes that stand still; leave it out, or train without "
        "model.dynamic");
}

// The cap that the run found at its start stays, however much memory is free now.
Config with_known_cap(Config config, const RunProgress& progress) {
  if (config.density.max_gaussians == kAutoCount && progress.growth_cap > 0)
    config.density.max_gaussians = progress.growth_cap;
  return config;
}

Vec3f random_background(const Config& config, int step) {
  const Random random{config.train.seed, RandomStream::background};
  const Vec4f u = random.uniform4(std::uint64_t(step));
  return {u.x, u.y, u.z};
}

std::vector<std::uint32_t> visible_rows(const Gaussians& gaussians) {
  const GaussiansSpan span = gaussians.span();
  std::vector<std::uint32_t> rows;
  for (std::uint32_t i = 0; i < gaussians.count(); ++i) {
    const float opacity = sigmoid(span.logit_opacity[i]) * filter_share(span, i, span.log_scale[i]);
    if (!(opacity < kMinAlpha)) rows.push_back(i);
  }
  return rows;
}

// The Gaussians as they are, with a filter if the run has one.
GaussianModel copy_of_result(Trainer& trainer) {
  GaussianModel model = host_copy(trainer.model().gaussians, trainer.config().model.sh_degree,
                                  trainer.settings().antialias);
  model.world_offset = trainer.scene().world_offset;
  return model;
}

}  // namespace

Trainer::Trainer(const Scene& scene, const Config& config, Backend& backend, TrainingModel model)
    : run_{with_views(scene),
           config,
           backend,
           Schedule(config, scene.extent, scene.train_views.size()),
           render_settings(config),
           std::move(model),
           nullptr},
      recovery_(run_), views_(scene.train_views.size(), config.train.seed), views_ahead_(views_) {
  check_model(config);
  const RunChoices choices{config.loss.kind, make_photometric_model(config.photometric)};
  check_supported(config, backend.features(), backend.name());
  backend.use(choices);
  if (scene.time_count > 1 && !config.model.dynamic)
    log_warning("{}", text_of_moving_scene(scene.time_count));
  if (scene.time_count <= 1 && config.model.dynamic)
    log_warning(
        "the photos have no times, so that nothing can move: train without -c dynamic, or say with "
        "dataset.times where the times are (docs/guide/moving_scenes.md)");
  backend.device().upload_views(scene.train_views,
                                std::size_t(double(config.train.photo_gib) * kBytesPerGib));
  prepare_surface_terms();
  run_.settings.sh_degree = 0;  // raised by the schedule
  std::int64_t& cap = run_.config.density.max_gaussians;
  const bool is_auto = cap == kAutoCount;
  if (is_auto) cap = affordable_gaussians(scene, run_.model, backend.memory(), run_.config);
  control_density_by(make_density_control(run_.config, run_.schedule, scene.extent));
  if (is_auto) run_.density->set_growth_cap(cap);  // so that checkpoints keep it
  // What fits is more than most runs come to.
  if (!is_auto && &backend.memory() != &host_memory() && rises_to_cap(run_.config))
    reserve_rows(run_.model, run_.config, backend.memory());
}

Trainer::Trainer(const Scene& scene, const Config& config, Backend& backend)
    : Trainer(scene, resolved_config(config, scene), backend,
              initial_model(with_views(scene), resolved_config(without_file(config), scene),
                            backend.memory())) {}

Trainer::Trainer(const Scene& scene, const Config& config, Backend& backend, TrainingState from)
    : Trainer(scene, with_known_cap(resolved_config(config, scene), from.progress), backend,
              TrainingModel(backend.memory())) {
  recovery_.resume(std::move(from));
}

void Trainer::control_density_by(std::unique_ptr<DensityControl> density) {
  if (run_.density) density->set_growth_cap(run_.density->growth_cap());
  run_.density = std::move(density);
  run_.density->set_region(region_of(run_.config.density, run_.scene.world_offset));
  run_.density->set_photos({run_.scene.train_views.size(), [this](std::size_t photo, int step) {
                              return photo_of(recovery_.instead_of(photo), step);
                            }});
}

// ---- the loop ----------------------------------------------------------------------------------

void Trainer::run() {
  begin();
  for (bool goes_on = !run_.is_over(); goes_on;) goes_on = take();
  end();
}

bool Trainer::take() {
  const int before = run_.step;
  advance(end_of_batch());
  const bool is_stopped = stop_requested_;
  // Log, evaluate, save: never inside a step
  for (int step = before + 1; step <= run_.step; ++step)
    if (recovery_.is_sound() && step < run_.schedule.steps())
      notify([&](Observer& observer) { observer.after_step(step, *this); });
  if (recovery_.checkpoint_or_roll_back(before, is_stopped)) {
    begin();
    for (Observer* observer : observers_) observer->after_rollback(run_.step, *this);
  }
  return !run_.is_over() && !is_stopped;
}

void Trainer::end() {
  finish_model();
  if (run_.is_over()) notify([&](Observer& observer) { observer.after_step(run_.step, *this); });
  notify([&](Observer& observer) { observer.after_run(*this); });
}

// The last step of the batch that comes next. Batches end at multiples of their size, wherever a
// run was resumed. Where a photo is suspected of breaking the model, it is trained on alone.
int Trainer::end_of_batch() const {
  const int next = run_.step + 1;
  const int batch = recovery_.is_watching(next) ? 1 : run_.config.train.batch;
  return std::min((run_.step / batch + 1) * batch, run_.schedule.steps());
}

// Takes the steps up to `last_step` as one batch. What the schedule asks for after any of them
// happens after the batch.
void Trainer::advance(int last_step) {
  const TrainingTime time(run_);
  const int first_step = run_.step + 1;
  // Render, compare, differentiate, update               3DGS Eq. 3-7; Faster-GS Sec.
  // "Optimization"
  recovery_.guarded(fmt::format("step {}", last_step), [&] { take_batch(last_step); });
  run_.step = last_step;
  prefetch_decode(first_step + int(kPhotosAhead), last_step + int(kPhotosAhead));
  recovery_.check_watched_step();
  for (int step = first_step; step <= last_step; ++step) {
    // Clone, split, prune, reset: 3DGS Sec. 5.2; or relocate and grow: MCMC
    if (recovery_.is_sound()) control_density(step);
    // Unlock SH bands; keep neighbors adjacent in memory
    if (recovery_.is_sound()) maintain(step);
  }
}

void Trainer::take_batch(int last_step) {
  batch_.clear();
  for (int step = run_.step + 1; step <= last_step; ++step) {
    const View& view = view_of(views_, step);
    batch_.push_back(photo_of(std::size_t(&view - run_.scene.train_views.data()), step));
  }
  run_.backend.device().prefetch_next(view_of(views_, last_step + 1));
  const int photos = int(batch_.size());
  Update update{run_.schedule.learning_rates(last_step), run_.schedule.adam_rule(photos)};
  update.photometric_rate = run_.schedule.photometric_rate(last_step);
  update.pose_rate = run_.schedule.pose_rate(last_step);
  update.photo_rule = batch_rule(update.rule.steps);
  update.rounding_seed = run_.config.train.seed;
  if (update.rule.steps > 1) {
    for_each_array([&](const char*, float& rate) { rate *= batch_rate(photos); }, update.rates);
    update.photometric_rate *= batch_rate(photos);
    update.pose_rate *= batch_rate(photos);
  }
  LossSettings loss{run_.config.loss.lambda_dssim};
  loss.depth_weight = run_.schedule.depth_weight(last_step);
  loss.surface = run_.schedule.surface_weights(last_step);
  const DensityStep density = run_.density->of_step(last_step);
  if (density.absolute_gradient)
    for (TrainingPhoto& photo : batch_) photo.settings.absolute_gradient = true;
  run_.backend.step(run_.model, {{batch_.data(), batch_.size()}, loss, update, density});
}

TrainingPhoto Trainer::photo_of(std::size_t row, int step) {
  const View& view = run_.scene.train_views[row];
  TrainingPhoto photo{&view, settings_of(step), run_.schedule.photo_reduction(step, view.camera),
                      row};
  photo.neighbor = neighbor_of(row, step);
  const Random random{run_.config.train.seed, RandomStream::surface_neighbors};
  if (photo.neighbor)
    photo.patch_phase = int(random.below(kPatchStride * kPatchStride, std::uint64_t(step), 1));
  return photo;
}

const View* Trainer::neighbor_of(std::size_t row, int step) const {
  if (neighbors_.empty() || neighbors_[row].empty() ||
      !(run_.schedule.surface_weights(step).photo > 0))
    return nullptr;
  const std::vector<std::uint32_t>& neighbors = neighbors_[row];
  const Random random{run_.config.train.seed, RandomStream::surface_neighbors};
  return &run_.scene.train_views[neighbors[random.below(std::uint32_t(neighbors.size()),
                                                        std::uint64_t(step))]];
}

void Trainer::prepare_surface_terms() {
  if (!run_.config.surface.is_on()) return;
  const std::vector<View>& views = run_.scene.train_views;
  for (const View& view : views)
    if (view.camera.has_lens())
      throw UsageError(
          "surface terms see through no lens; train with dataset.lens = \"undistort\" and "
          "dataset.rolling_shutter = false, or without surface.normal_weight, "
          "surface.photo_weight and surface.prior_weight");
  if (run_.config.surface.prior_weight > 0 && !have_normal_maps(views))
    throw UsageError(
        "surface.prior_weight is above 0, and no training photo has a normal map; put maps into "
        "the folder normals of the scene, name theirs with --set dataset.normals=FOLDER, or set "
        "surface.prior_weight to 0");
  if (!(run_.config.surface.photo_weight > 0)) return;
  neighbors_ = neighbor_views(views, run_.scene.points);
  const auto alone = std::count_if(neighbors_.begin(), neighbors_.end(),
                                   [](const auto& of_view) { return of_view.empty(); });
  if (alone > 0)
    log_warning(
        "{} of {} photos have no neighbor that shows the same from beside them, and train "
        "without the loss of photos",
        alone, views.size());
}

RenderSettings Trainer::settings_of(int step) {
  if (run_.config.render.background == Background::random)
    run_.settings.background = random_background(run_.config, step);
  return run_.settings;
}

void Trainer::control_density(int step) {
  const bool refines = run_.schedule.refine(step);
  if (refines) recovery_.check_parameters();
  if (!recovery_.is_sound()) return;
  recovery_.guarded_or_skipped("density control",
                               [&] { run_.density->after_step(run_.model, run_.backend, step); });
  recovery_.check_is_not_empty();
}

void Trainer::maintain(int step) {
  if (run_.schedule.raise_sh_degree(step) && run_.settings.sh_degree < run_.config.model.sh_degree)
    ++run_.settings.sh_degree;
  if (run_.schedule.reorder(step)) sort_by_morton();
  if (run_.config.model.filter_3d && run_.schedule.measure_filter(step))
    recovery_.guarded_or_skipped("the 3D filter", [&] { measure_filter(); });
}

// ---- before and after it -----------------------------------------------------------------------

void Trainer::begin() {
  prefetch_decode(run_.step + 1, run_.step + int(kPhotosAhead));
  if (run_.step > 0) return;
  sort_by_morton();
  if (run_.config.model.filter_3d) recovery_.guarded("the 3D filter", [&] { measure_filter(); });
}

void Trainer::finish_model() {
  const TrainingTime time(run_);
  recovery_.begin_finish();
  run_.backend.synchronize(run_.model);
  recovery_.guarded_or_skipped("the final prune", [&] {
    if (run_.config.density.camera_clearance > 0) remove_floaters();
    run_.backend.rows().prune(run_.model, kMinAlpha);
  });
  sort_by_morton();
  recovery_.end_finish();
}

void Trainer::sort_by_morton() {
  recovery_.guarded_or_skipped("the Morton order",
                               [&] { run_.backend.rows().sort_by_morton(run_.model); });
}

// Each Gaussian's filter follows its mean.   Yu et al. 2024
void Trainer::measure_filter() {
  if (!run_.model.poses.empty()) run_.backend.synchronize(run_.model);
  const std::vector<Camera> cameras = refined_cameras(run_.model.poses, run_.scene.train_views);
  run_.backend.rows().measure_filter(run_.model, cameras, run_.config.render.near_plane);
}

void Trainer::remove_floaters() {
  const FloaterFinder finder(run_.scene, run_.config.density.camera_clearance);
  const std::size_t before = run_.model.count();
  removed_floaters_ = gs::remove_floaters(run_.model, run_.backend.rows(), finder);
  if (removed_floaters_ > 0)
    log_info(
        "{} of {} Gaussians are removed ({:.2f} %), because photos look through them and no "
        "other photo sees them (density.camera_clearance)",
        removed_floaters_, before, 100.0 * double(removed_floaters_) / double(before));
}

const View& Trainer::view_of(ViewSampler& views, int step) {
  return run_.scene.train_views[recovery_.instead_of(views.view_of(step))];
}

void Trainer::prefetch_decode(int first_step, int last_step) {
  for (int step = first_step; step <= std::min(last_step, run_.schedule.steps()); ++step) {
    const View& view = view_of(views_ahead_, step);
    run_.backend.device().prefetch_decode(view);
    if (const View* const neighbor =
            neighbor_of(std::size_t(&view - run_.scene.train_views.data()), step))
      run_.backend.device().prefetch_decode(*neighbor);
  }
}

void Trainer::notify(const std::function<void(Observer&)>& f) {
  for (Observer* observer : observers_)
    recovery_.guarded("logging, evaluation or saving", [&] { f(*observer); });
}

// ---- looking at it -----------------------------------------------------------------------------

double Trainer::loss() {
  const double loss = run_.loss();
  recovery_.check_loss(loss);
  return loss;
}

RenderSettings Trainer::evaluation_settings() const {
  RenderSettings settings = render_settings(run_.config);
  settings.sh_degree = run_.settings.sh_degree;
  settings.for_backward = false;
  return settings;
}

GaussianModel copied_model(Trainer& trainer) {
  GaussianModel model = copy_of_result(trainer);
  bake_filter(model.gaussians);
  return model;
}

GaussianModel raw_model(Trainer& trainer) { return visible_part(copy_of_result(trainer)); }

GaussianModel visible_part(const GaussianModel& model) {
  return {rows_of(model.gaussians, visible_rows(model.gaussians)), model.sh_degree, model.is_ours,
          model.antialiased, model.world_offset};
}

GaussianModel trained_model(Trainer& trainer) {
  GaussianModel model = copied_model(trainer);
  const bool is_all_visible = visible_rows(model.gaussians).size() == model.gaussians.count();
  return is_all_visible ? std::move(model) : visible_part(model);
}

}  // namespace gs
