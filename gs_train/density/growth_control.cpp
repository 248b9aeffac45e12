// SPDX-License-Identifier: Apache-2.0
// Density control by the rules of a GrowthMethod (gs_core/density): which Gaussians grow, what they
// become, how opacities are lowered, and what is removed. docs/method/density.md explains the
// rules.
#include <limits>
#include <numeric>
#include <vector>

#include "gs_core/error.h"
#include "gs_train/density/density_control.h"

namespace gs {
namespace {

class GrowthControl final : public DensityControl {
 public:
  GrowthControl(const Config& config, const GrowthMethod& method, const Schedule& schedule,
                float scene_extent)
      : DensityControl(config.density.max_gaussians), schedule_(schedule), method_(method),
        rules_(rules_of(config, method, scene_extent)),
        prune_scale_(prune_scale_of(config, scene_extent)), seed_(config.train.seed),
        regularizers_(regularizers_of(config)) {
    if (method.rises_to_cap() && most_gaussians() <= 0)
      throw UsageError("density.strategy = \"" + config.density.strategy +
                       "\" needs a number of Gaussians to rise to; give it with --max-gaussians N "
                       "or --max-gaussians auto");
    // The rest needs the sums of training steps.
    GS_CHECK(!method.prune_unseen || method.score == GrowthScore::force);
    GS_CHECK(!method.prunes_shares() || !sums_pixel_values(method.score));
    GS_CHECK(sums_pixel_values(method.score) == (method.score_photos > 0));
  }

  DensityStep of_step(int step) const override {
    const bool needs_forces =
        method_.score == GrowthScore::force || schedule_.measure_sensitivity(step);
    return {.gather_statistics = schedule_.gather_statistics(step),
            .regularizers = regularizers_,
            .score = needs_forces ? GrowthScore::force : GrowthScore::gradient};
  }

  RefineReport after_step(TrainingModel& model, Backend& backend, int step) override {
    RefineReport report;
    if (schedule_.refine(step)) {
      GrowthRules rules = rules_in(step, model);
      if (method_.score_photos > 0) rules.score_threshold *= float(score(model, backend, step));
      report = backend.rows().grow(model, rules, seed_, step);
      if (method_.opacity_cap < 1) backend.rows().reset_opacity(model, method_.opacity_cap);
    }
    report.pruned += prune(model, backend, step);
    if (schedule_.reset_opacity(step)) backend.rows().lower_opacity(model, method_.opacity);
    return report;
  }

 private:
  static GrowthRules rules_of(const Config& config, const GrowthMethod& method,
                              float scene_extent) {
    const DensityConfig& density = config.density;
    GrowthRules rules;
    rules.limits = {density.gradient_threshold, method.small_scale * scene_extent,
                    density.prune_opacity, std::numeric_limits<float>::infinity(), 0};
    rules.score = method.score;
    rules.select = method.select;
    rules.score_threshold = method.score_threshold;
    rules.most_growth = method.most_growth;
    rules.split = method.split;
    return rules;
  }

  GrowthRules rules_in(int step, const TrainingModel& model) const {
    GrowthRules rules = rules_;
    rules.limits.region = region();
    const std::int64_t target =
        growth_target(method_.curve, schedule_.growth_share(step), std::int64_t(model.first_count),
                      most_gaussians(), double(method_.ramp_from));
    rules.limits.max_gaussians = most_gaussians() > 0 ? std::min(target, most_gaussians()) : target;
    if (schedule_.prune_large(step)) rules.limits.prune_scale = prune_scale_;
    rules.prunes_unseen = method_.prune_unseen && schedule_.has_seen_all_views(step);
    return rules;
  }

  // The score pass of a refinement. Returns the number of its photos.
  std::size_t score(TrainingModel& model, Backend& backend, int step) const {
    backend.synchronize(model);
    std::vector<TrainingPhoto> drawn;
    for (const std::size_t photo : drawn_photos(step)) drawn.push_back(photos().photo(photo, step));
    backend.score_photos(model, {drawn.data(), drawn.size()}, {method_.score, method_.mask_error});
    return drawn.size();
  }

  // Each photo once, in their order: the draw is that of a set.
  std::vector<std::size_t> drawn_photos(int step) const {
    std::vector<std::size_t> all(photos().count);
    std::iota(all.begin(), all.end(), std::size_t(0));
    const std::size_t count = std::min(all.size(), std::size_t(method_.score_photos));
    const Random random{seed_, RandomStream::score_photos};
    for (std::size_t k = 0; k < count; ++k) {
      const auto left = std::uint32_t(all.size() - k);
      std::swap(all[k], all[k + random.below(left, std::uint64_t(step), std::uint32_t(k))]);
    }
    all.resize(count);
    std::sort(all.begin(), all.end());
    return all;
  }

  // What goes besides the pruning of refinements. At most one of them happens in a step, and none
  // with a refinement: where memory runs out, a step of density control is taken again as a whole.
  std::size_t prune(TrainingModel& model, Backend& backend, int step) const {
    if (const double share = schedule_.sensitivity_prune(step);
        share > 0 && model.statistics.has_sums) {
      const std::size_t pruned = backend.rows().prune_share(model, PruneOrder::sensitivity, share);
      clear_columns(model, RowRole::statistic);
      return pruned;
    }
    if (const double share = schedule_.recovery_prune(step); share > 0)
      return backend.rows().prune_share(model, PruneOrder::opacity, share);
    if (schedule_.prune_late(step)) return backend.rows().prune(model, method_.late_prune_opacity);
    return 0;
  }

  const Schedule schedule_;
  const GrowthMethod method_;
  const GrowthRules rules_;
  const float prune_scale_;  // world units
  const std::uint64_t seed_;
  const Regularizers regularizers_;
};

}  // namespace

std::unique_ptr<DensityControl> make_growth_control(const Config& config,
                                                    const GrowthMethod& method,
                                                    const Schedule& schedule, float scene_extent) {
  return std::make_unique<GrowthControl>(config, method, schedule, scene_extent);
}

}  // namespace gs
