// SPDX-License-Identifier: Apache-2.0
#include "gs_train/loop/lazy_choice.h"

#include <algorithm>

#include "gs_core/error.h"
#include "gs_core/log.h"
#include "gs_core/math/area_filter.h"
#include "gs_train/loop/view_sampler.h"

namespace gs {
namespace {

constexpr int kMostUpdates = 16, kLeastUpdates = 4;  // whose views are rendered for the choice
constexpr double kNumber = sizeof(float);
// With compact moments a lazy update takes so many times as long as its bytes say, because each
// code is decoded twice and rounded (measured, docs/lazy_adam.md). With tiny ones it was not
// measured; they are taken to be alike.
constexpr double kTimeOfCodes = 1.6;

int numbers_updated_promptly(const Gaussians& arrays) {
  int count = 0;
  for_each_prompt_array(
      [&](const char*, const auto& array) { count += int(sizeof *array.data() / sizeof(float)); },
      arrays);
  return count;
}

int numbers_updated_lazily(const Gaussians& arrays) {
  int count = 0;
  for_each_lazy_array(
      [&](LazyQuantity, const auto& array) { count += int(sizeof *array.data() / sizeof(float)); },
      arrays);
  return count;
}

// Both ways of one number.
double bytes_of_number(MomentForm form) { return 2 * (kNumber + moment_bytes(form)); }

bool is_possible(const Config& config, const Backend& backend) {
  return backend.can_update_lazily() && !config.poses.refine;
}

// By the photos of the next updates.
SeenShares measure_seen(TrainingRun& run) {
  const std::size_t rows = run.model.count();
  SeenShares seen{0, 0, run.schedule.batch(run.step + 1)};
  const int updates = std::clamp(kMostUpdates / seen.photos, kLeastUpdates, kMostUpdates);
  RenderSettings settings = run.settings;
  settings.for_backward = false;
  settings.with_depths = false;
  ViewSampler views(run.scene.train_views.size(), run.config.train.seed);
  RenderPass pass(run.backend.memory());
  int step = run.step;
  for (int update = 0; update < updates; ++update) {
    std::vector<std::uint8_t> is_seen(rows, 0);
    for (int photo = 0; photo < seen.photos; ++photo) {
      const Camera& camera = run.scene.train_views[views.view_of(++step)].camera;
      const int reduction =
          run.schedule.photo_reduction(std::min(step, run.schedule.steps()), camera);
      run.backend.renderer().forward(run.model.gaussians.span(), reduced(camera, reduction),
                                     settings, pass);
      const std::vector<std::uint32_t> tile_counts = pass.tile_counts.download();
      for (std::size_t i = 0; i < rows; ++i) {
        seen.by_photos += tile_counts[i] > 0;
        is_seen[i] |= tile_counts[i] > 0;
      }
    }
    seen.by_update += double(std::count(is_seen.begin(), is_seen.end(), 1));
  }
  seen.by_update /= double(rows) * updates;
  seen.by_photos /= double(rows) * updates;
  return seen;
}

}  // namespace

double prompt_update_bytes(const Gaussians& arrays, MomentForm form) {
  return (numbers_updated_promptly(arrays) + numbers_updated_lazily(arrays)) *
         bytes_of_number(form);
}

// A photo that sees a row also reads its moments: to draw it, and among several photos of an update
// once more for its gradients.
double lazy_update_bytes(const Gaussians& arrays, MomentForm form, const SeenShares& seen) {
  const double stamp = 2 * sizeof(std::uint32_t), numbers = numbers_updated_lazily(arrays);
  const double looks = (seen.photos > 1 ? 2 : 1) * seen.by_photos;
  return numbers_updated_promptly(arrays) * bytes_of_number(form) + stamp +
         numbers * (seen.by_update * bytes_of_number(form) + looks * moment_bytes(form));
}

void check_lazy(const Config& config, const Backend& backend) {
  if (config.optimizer.lazy != LazyMode::on) return;
  if (config.poses.refine)
    throw UsageError(
        "optimizer.lazy=on does not go with poses.refine yet; leave optimizer.lazy off, or train "
        "without poses.refine");
  if (!backend.can_update_lazily())
    throw UsageError("optimizer.lazy=on is not there on " + backend.name() +
                     " yet; leave optimizer.lazy off, or set train.ranks=1");
}

void begin_or_end_lazy(TrainingRun& run) {
  LazyState& lazy = run.model.lazy;
  lazy.rounding_seed = run.config.train.seed;
  const LazyMode mode = run.config.optimizer.lazy;
  const bool is_offloaded = run.model.memory().offloads_sh();
  const bool begins_with_offload = mode == LazyMode::with_offload && is_offloaded &&
                                   run.step == 0 && is_possible(run.config, run.backend);
  if (!lazy.is_on && (mode == LazyMode::on || begins_with_offload))
    begin_lazy(run.model, run.config.train.seed);
  if (lazy.is_on && (mode == LazyMode::off || !is_possible(run.config, run.backend))) {
    run.backend.rows().catch_up(run.model);
    end_lazy(run.model);
  }
  if (is_offloaded && !lazy.is_on && !run.is_over())
    log_warning(
        "each step moves the SH of all Gaussians to the GPU and back (train.offload), because this "
        "run updates all of them at once{}",
        run.config.poses.refine ? "; poses.refine needs that"
                                : "; a new run with optimizer.lazy=on moves those that are seen");
}

void choose_lazy(TrainingRun& run, int step) {
  if (run.config.optimizer.lazy != LazyMode::automatic || run.model.lazy.is_on) return;
  if (step != std::max(run.schedule.steps() / 10, 1) || run.model.count() == 0) return;
  if (!is_possible(run.config, run.backend)) {
    log_info("step {}: optimizer.lazy=auto is off: it goes with neither poses.refine nor ranks",
             step);
    return;
  }
  if (!run.backend.has_updates_bound_by_memory()) {
    log_info("step {}: optimizer.lazy=auto is off: it saves no time on {}", step,
             run.backend.name());
    return;
  }
  run.backend.synchronize(run.model);
  const SeenShares seen = measure_seen(run);
  const double prompt = prompt_update_bytes(run.model.gaussians, run.model.moment_form),
               lazy = lazy_update_bytes(run.model.gaussians, run.model.moment_form, seen);
  const bool pays = lazy * (are_codes(run.model.moment_form) ? kTimeOfCodes : 1) < prompt;
  log_info(
      "step {}: an update sees {:.0f} % of the Gaussians: optimizer.lazy=auto is {} ({:.0f} "
      "instead of {:.0f} bytes a Gaussian)",
      step, 100 * seen.by_update, pays ? "on" : "off", lazy, prompt);
  if (pays) begin_lazy(run.model, run.config.train.seed);
}

}  // namespace gs
