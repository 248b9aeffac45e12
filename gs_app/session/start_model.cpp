// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/start_model.h"

#include <algorithm>

#include "data_loaders/formats/coding/finite_rows.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/log.h"
#include "gs_train/loop/view_sampler.h"

namespace gs {
namespace {

// Moves the model from the coordinates of the file to those of the scene; an offset may have been
// subtracted from either.
void move_to_offset(GaussianModel& model, const Vec3d& offset) {
  if (model.world_offset == offset) return;
  const Vec3d shift = model.world_offset - offset;
  for (std::size_t i = 0; i < model.gaussians.count(); ++i)
    model.gaussians.mean[i] = Vec3f(Vec3d(model.gaussians.mean[i]) + shift);
  model.world_offset = offset;
}

void zero_above_degree(Gaussians& gaussians, int degree) {
  for (std::size_t i = 0; i < gaussians.count(); ++i)
    std::fill(gaussians.sh_rest[i].coefficient + sh_rest_count(degree),
              gaussians.sh_rest[i].coefficient + kShRestCount, Vec3f(0));
}

// Throws UsageError for Gaussians of the other kind.
void check_kind(const std::filesystem::path& file, const GaussianModel& model,
                const Config& config) {
  if (model.gaussians.has_time == config.model.dynamic) return;
  throw UsageError(
      file.string() +
      (config.model.dynamic
           ? " holds 3D Gaussians, but this run trains Gaussians in space and time "
             "(model.dynamic); "
             "start from a model of such a run, or train without -c dynamic"
           : " holds Gaussians in space and time, but this run trains 3D Gaussians; add -c "
             "dynamic, "
             "or start from one moment of it that `gemsplat export --time T` has written"));
}

GaussianModel read_start(const Config& config) {
  const std::filesystem::path file = config.model.start_from;
  OpenedModel opened = open_model(file, std::nullopt);
  check_kind(file, opened.model, config);
  const std::size_t all = opened.model.gaussians.count();
  GaussianModel model = finite_model(opened.model);
  if (model.gaussians.count() < all)
    log_warning("{} of {} Gaussians in {} are not finite, and are left out",
                all - model.gaussians.count(), all, file.string());
  if (model.gaussians.count() == 0)
    throw Error("there is no Gaussian to start from in " + file.string() + "; name another model");
  if (model.antialiased != config.render.antialias)
    log_warning("{} was trained {} antialiasing, but this run trains {} it (--antialiased)",
                file.string(), model.antialiased ? "with" : "without",
                config.render.antialias ? "with" : "without");
  return model;
}

// The views of the first epoch, which every checkpoint holds.
std::vector<std::uint32_t> first_view_order(const Scene& scene, const Config& config) {
  ViewSampler views(scene.train_views.size(), config.train.seed);
  views.view_of(1);
  return {views.order().begin(), views.order().end()};
}

}  // namespace

TrainingState state_from_model(const Config& config, const Scene& scene) {
  GaussianModel model = read_start(config);
  move_to_offset(model, scene.world_offset);
  const int degree = std::min(model.sh_degree, config.model.sh_degree);
  zero_above_degree(model.gaussians, degree);
  log_info("training starts from the {} Gaussians in {}, SH degree {}",
           with_commas(model.gaussians.count()), config.model.start_from, degree);
  TrainingState state;
  state.progress.sh_degree = degree;
  state.progress.strikes.assign(scene.train_views.size(), 0);
  state.progress.view_order = first_view_order(scene, config);
  state.model.gaussians = std::move(model.gaussians);
  clear_history(state.model);
  return state;
}

}  // namespace gs
