// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/start_model.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_app/run/open_model.h"
#include "gs_app/run/text.h"
#include "gs_app/session/align_start.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_model/formats/coding/finite_rows.h"
#include "gs_model/formats/model_info.h"
#include "gs_model/formats/ply/ply.h"
#include "gs_train/loop/view_sampler.h"

namespace gs {
namespace {

constexpr double kMostError = 0.05;  // of the spread of the cameras, when a model is turned
// Larger numbers are no model of anything, and their products leave the range of floats.
constexpr float kLargestMean = 1e9f;    // world units
constexpr float kLargestLogScale = 20;  // 5e8 world units
constexpr float kLargestColor = 1e6f;   // of a coefficient; colors are 0 to 1

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

// If the run trains with a 3D filter and the start has one, takes the scales and opacities before
// it. The trainer measures the filter again.
void take_raw_model(const Config& config, OpenedModel& opened) {
  if (!config.model.filter_3d) return;
  std::filesystem::path raw = opened.ply;
  if (opened.run) raw = opened.run->raw_ply(opened.run->newest_step().value());
  if (!std::filesystem::exists(raw) || !is_ply_with_filter_3d(raw)) return;
  const Vec3d offset = opened.model.world_offset;
  opened.model = read_raw_gaussian_ply(raw);
  opened.model.world_offset = offset;
}

// Brings the model of a run into the coordinates of the scene, by the photos that both have.
void align(const OpenedModel& opened, const Scene& scene, GaussianModel& model) {
  if (!opened.run || !std::filesystem::exists(opened.run->cameras())) return;
  const Vec3d offset = model.world_offset - scene.world_offset;
  const auto shared =
      shared_cameras(read_cameras_json(opened.run->cameras(), model.world_offset), offset, scene);
  if (!shared || shared->coincide) return;
  const std::string name = opened.run->root().string();
  if (shared->error > kMostError)
    throw UsageError(fmt::format(
        "{} photos of {} are also in the run {}, but their cameras stand elsewhere, and no turn "
        "and scale brings them together; start from a model of this scene, or name the model's PLY "
        "instead of the run if its coordinates are those of the scene",
        shared->count, scene.source, name));
  transform_model(model, shared->transform);
  model.world_offset = scene.world_offset;
  log_info(
      "{} was trained in other coordinates; its model is turned, moved and scaled by {:.4g}, so "
      "that "
      "the cameras of the {} photos that this scene has, too, stand where they stand here (up to "
      "{:.2g} % of the distances between them)",
      name, shared->transform.scale, shared->count, 100 * shared->error);
}

bool is_small(const Vec3f& values, float largest) {
  return std::abs(values.x) <= largest && std::abs(values.y) <= largest &&
         std::abs(values.z) <= largest;
}

// Whether the numbers of a row can be trained on. NaN and infinity cannot.
bool is_usable(const Gaussians& gaussians, std::size_t i, int rest_count) {
  bool is_usable =
      is_small(gaussians.mean[i], kLargestMean) && is_small(gaussians.sh0[i], kLargestColor);
  for (int axis = 0; axis < 3; ++axis)
    is_usable &= gaussians.log_scale[i][axis] <= kLargestLogScale;
  for (int k = 0; k < rest_count; ++k)
    is_usable &= is_small(gaussians.sh_rest[i].coefficient[k], kLargestColor);
  return is_usable;
}

GaussianModel usable_model(const GaussianModel& model) {
  const GaussianModel finite = finite_model(model);
  std::vector<std::uint32_t> rows;
  for (std::uint32_t i = 0; i < finite.gaussians.count(); ++i)
    if (is_usable(finite.gaussians, i, sh_rest_count(finite.sh_degree))) rows.push_back(i);
  return rows_of(finite, rows);
}

GaussianModel read_start(const Config& config, const Scene& scene) {
  const std::filesystem::path file = config.model.start_from;
  OpenedModel opened = open_model(file, std::nullopt);
  take_raw_model(config, opened);
  check_kind(file, opened.model, config);
  const std::size_t all = opened.model.gaussians.count();
  GaussianModel model = usable_model(opened.model);
  if (model.gaussians.count() < all)
    log_warning(
        "{} of {} Gaussians in {} are not finite, or have numbers that are too large to "
        "train with, and are left out",
        all - model.gaussians.count(), all, file.string());
  if (model.gaussians.count() == 0)
    throw Error("there is no Gaussian to start from in " + file.string() + "; name another model");
  if (model.antialiased != config.render.antialias)
    log_warning("{} was trained {} antialiasing, but this run trains {} it (--antialiased)",
                file.string(), model.antialiased ? "with" : "without",
                config.render.antialias ? "with" : "without");
  align(opened, scene, model);
  move_to_offset(model, scene.world_offset);
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
  GaussianModel model = read_start(config, scene);
  const int degree = std::min(model.sh_degree, config.model.sh_degree);
  zero_above_degree(model.gaussians, degree);
  log_info("training starts from the {} Gaussians in {}, SH degree {}",
           with_commas(model.gaussians.count()), config.model.start_from, degree);
  TrainingState state;
  state.progress.sh_degree = degree;
  state.progress.strikes.assign(scene.train_views.size(), 0);
  state.progress.view_order = first_view_order(scene, config);
  state.model.gaussians = std::move(model.gaussians);
  state.model.store_moments_as(config.optimizer.moments);
  clear_history(state.model);
  return state;
}

}  // namespace gs
