// SPDX-License-Identifier: Apache-2.0
// The strategy "budgeted": clones, splits and prunes as "adaptive" does, but the rows that grow are
// chosen by a score, and their number follows a curve up to density.max_gaussians. docs/density.md
// names the methods that its settings stand for.
#include <limits>

#include "gs_core/error.h"
#include "gs_train/density/density_control.h"

namespace gs {
namespace {

class BudgetedControl final : public DensityControl {
 public:
  BudgetedControl(const Config& config, const Schedule& schedule, float scene_extent)
      : DensityControl(config.density.max_gaussians), schedule_(schedule), density_(config.density),
        rules_(rules_of(config, scene_extent)), prune_scale_(prune_scale_of(config, scene_extent)),
        seed_(config.train.seed), regularizers_(regularizers_of(config)) {
    if (needs_budget(density_.curve) && most_gaussians() <= 0)
      throw UsageError(
          "density.curve needs a number of Gaussians to rise to; give it with --max-gaussians N or "
          "--max-gaussians auto, or set density.curve=none");
    if (density_.prune_unseen && !needs_fragment_sums(density_.score))
      throw UsageError(
          "density.prune_unseen needs a score that counts pixels; set density.score to force, "
          "error, mask or edge");
    if ((density_.soft_prune > 0 || density_.hard_prune > 0) && sums_pixel_values(density_.score))
      throw UsageError(
          "density.soft_prune and density.hard_prune need the score gradient or force; set "
          "density.score");
  }

  DensityStep of_step(int step) const override {
    const bool measures = schedule_.measure_sensitivity(step);
    return {.gather_statistics = schedule_.gather_statistics(step),
            .regularizers = regularizers_,
            .score = measures ? GrowthScore::force : density_.score,
            .mask_error = density_.mask_error};
  }

  RefineReport after_step(TrainingModel& model, Backend& backend, int step) override {
    RefineReport report;
    if (schedule_.refine(step)) {
      report = backend.rows().grow(model, rules_in(step, model), seed_, step);
      if (density_.opacity_cap < 1) backend.rows().reset_opacity(model, density_.opacity_cap);
    }
    report.pruned += prune(model, backend, step);
    if (schedule_.reset_opacity(step)) lower_opacity(model, backend, step);
    return report;
  }

 private:
  static GrowthRules rules_of(const Config& config, float scene_extent) {
    const DensityConfig& density = config.density;
    GrowthRules rules;
    rules.limits = {density.gradient_threshold,
                    density.small_scale * scene_extent,
                    density.prune_opacity,
                    std::numeric_limits<float>::infinity(),
                    0,
                    prune_scale_within(config, scene_extent)};
    rules.score = density.score;
    rules.select = density.select;
    rules.score_threshold = density.score_threshold;
    rules.most_growth = density.most_growth;
    rules.split = {density.split,        density.split_offset, density.split_along,
                   density.split_across, density.keep_parent,  density.child_opacity_factor};
    return rules;
  }

  GrowthRules rules_in(int step, const TrainingModel& model) const {
    GrowthRules rules = rules_;
    rules.limits.region = region();
    const std::int64_t target =
        growth_target(density_.curve, schedule_.growth_share(step), std::int64_t(model.first_count),
                      most_gaussians(), double(density_.ramp_from));
    rules.limits.max_gaussians = most_gaussians() > 0 ? std::min(target, most_gaussians()) : target;
    if (schedule_.prune_large(step)) rules.limits.prune_scale = prune_scale_;
    rules.prunes_unseen = density_.prune_unseen && schedule_.has_seen_all_views(step);
    if (needs_fragment_sums(density_.score))
      rules.score_threshold *= float(schedule_.photos_of_statistics(step));
    return rules;
  }

  // What goes besides the pruning of refinements. At most one of them happens in a step, and none
  // with a refinement: where memory runs out, a step of density control is taken again as a whole.
  std::size_t prune(TrainingModel& model, Backend& backend, int step) const {
    if (const double share = schedule_.sensitivity_prune(step);
        share > 0 && model.statistics.has_sums) {
      const std::size_t pruned = backend.rows().prune_share(model, PruneOrder::sensitivity, share);
      clear_statistics(model);
      return pruned;
    }
    if (const double share = schedule_.recovery_prune(step); share > 0)
      return backend.rows().prune_share(model, PruneOrder::opacity, share);
    if (schedule_.prune_late(step)) return backend.rows().prune(model, density_.late_prune_opacity);
    return 0;
  }

  void lower_opacity(TrainingModel& model, Backend& backend, int step) const {
    if (density_.opacity_policy == OpacityPolicy::none) return;
    OpacityRule rule{density_.opacity_policy, density_.opacity_amount, density_.opacity_clears};
    if (rule.policy == OpacityPolicy::subtract)
      rule.amount *= float(1 - double(step) / double(schedule_.steps_without_extra()));
    if (rule.amount > 0) backend.rows().lower_opacity(model, rule);
  }

  const Schedule schedule_;
  const DensityConfig density_;
  const GrowthRules rules_;
  const float prune_scale_;  // world units
  const std::uint64_t seed_;
  const Regularizers regularizers_;
};

}  // namespace

std::unique_ptr<DensityControl> make_budgeted_control(const Config& config,
                                                      const Schedule& schedule,
                                                      float scene_extent) {
  return std::make_unique<BudgetedControl>(config, schedule, scene_extent);
}

}  // namespace gs
