// SPDX-License-Identifier: Apache-2.0
// Stage 9 for one Gaussian at a time: its score, the children of a split, and changes of its opacity;
// and how many Gaussians there shall be. The methods of gs_core/density choose among these rules;
// docs/method/density.md explains them.
#pragma once

#include <cmath>
#include <limits>

#ifndef __CUDA_ARCH__
#include <bit>
#endif

#include "gs_core/math/constants.h"
#include "gs_core/math/density/density.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/types.h"

namespace gs {

/// By what Gaussians are chosen to grow.
enum class GrowthScore { gradient, force, error, mask, edge };
/// How the number of Gaussians rises to its limit.
enum class GrowthCurve { none, linear, root, parabola, ramp };
/// Which of them grow where not all may: those with the largest scores, or a draw.
enum class GrowthSelection { top_k, race };
/// Which photos the statistics of a refinement come from: all since the refinement before, or the
/// last pass over all photos.
enum class StatisticsWindow { refinement, epoch };
/// Where the children of a split lie.
enum class SplitPlacement { draw, axis };
/// How opacities are lowered now and then.
enum class OpacityPolicy { none, reset, halve };
/// Which of Adam's moments that clears.
enum class MomentClearing { none, opacity, all };
/// By what the lowest Gaussians are found, to remove a share of them.
enum class PruneOrder { opacity, sensitivity };

/// True for the scores that are made of FragmentSums.
GS_HD bool needs_fragment_sums(GrowthScore score) { return score != GrowthScore::gradient; }
/// True for the scores that sum values of pixels, which are never negative.
GS_HD bool sums_pixel_values(GrowthScore score) {
  return needs_fragment_sums(score) && score != GrowthScore::force;
}
/// True for the curves that rise to a number of Gaussians.
GS_HD bool needs_budget(GrowthCurve curve) { return curve != GrowthCurve::none; }

// ---- scores ------------------------------------------------------------------------------------

/// Sums over the fragments of one Gaussian, of forces in training steps or of values in a score pass;
/// count is their number, and w = T alpha is the weight of one.
///
///                 first     second
///   force         sum f     sum f^2    f = alpha dE/dalpha, E the loss times its 3 H W values
///   all others    sum w v   sum v      v the pixel's value: error, mask or edge
struct FragmentSums {
  float count = 0, first = 0, second = 0;
};
GS_HD void add_to(FragmentSums& sum, const FragmentSums& part) {
  sum.count += part.count;
  sum.first += part.first;
  sum.second += part.second;
}
/// How much the pixels of a Gaussian disagree about its opacity: the number of fragments times the
/// variance of their forces f.                          after LiteGS (docs/method/density.md)
///
///   n (Q / (n + 1) - (F / (n + 1))^2) = n (Q (n + 1) - F^2) / (n + 1)^2
///
/// The products of floats are exact in double, so that no contraction changes the result.
GS_HD double force_score(const FragmentSums& sums) {
  const double n = double(sums.count), more = n + 1;
  const double spread = double(sums.second) * more - double(sums.first) * double(sums.first);
  return n * (spread / (more * more));
}

/// The score of a Gaussian; NaN where a statistic is.
GS_HD double growth_score(GrowthScore score, float visits, float gradient_norm,
                          const FragmentSums& sums) {
  switch (score) {
    case GrowthScore::gradient: break;
    case GrowthScore::force: return force_score(sums);
    case GrowthScore::error:
    case GrowthScore::edge: return double(sums.first);
    case GrowthScore::mask: return double(sums.second);
  }
  return double(gradient_norm) / double(max_of(visits, 1.0f));
}

// ---- pruning a share ---------------------------------------------------------------------------

/// The bits of a float, ordered as the floats are; NaN comes first.
GS_HD std::uint32_t ascending_bits(float value) {
  if (!(value == value)) return 0;
#ifdef __CUDA_ARCH__
  const std::uint32_t bits = __float_as_uint(value);
#else
  const std::uint32_t bits = std::bit_cast<std::uint32_t>(value);
#endif
  return bits >> 31 ? ~bits : bits | 0x80000000u;
}

/// The place of a Gaussian in an order; the lowest go first. The sensitivity is the sum of f^2 of
/// the score "force": how much the loss reacts to a Gaussian's values.   after Hanson et al. 2025
GS_HD std::uint64_t prune_key(PruneOrder order, float logit_opacity, const FragmentSums& sums) {
  return ascending_bits(order == PruneOrder::opacity ? logit_opacity : sums.second);
}

/// How many of so many Gaussians a share is.
inline std::size_t share_of(std::size_t count, double share) {
  return std::size_t(share * double(count));
}

// ---- children ----------------------------------------------------------------------------------

/// What a Gaussian becomes that is split.
struct SplitRules {
  SplitPlacement place = SplitPlacement::draw;
  float offset = 0, along = 1, across = 1;  // axis: standard deviations; factors of the scales
  bool keeps_parent = false;                // which then has one child
  float opacity_factor = 1;
  unsigned parts = 2;  // children of one that goes; on the axis there are two

  GS_HD bool changes_opacity() const { return opacity_factor != 1; }
  GS_HD unsigned children() const { return keeps_parent ? 1 : parts; }
  bool operator==(const SplitRules&) const = default;
};

/// Where a child lies, and its size.
struct ChildPlace {
  Vec3f offset;  // from the parent's mean, in the parent's standard deviations along its axes
  Vec3f scale;   // as a multiple of the parent's
};

/// Both children of a split along the longest axis: moved by `offset` standard deviations to either
/// side, and shrunk by `along` on this axis and by `across` on the others.       Improved-GS
GS_HD ChildPlace child_on_axis(const Vec3f& log_scale, const SplitRules& rules, float side) {
  const int axis = log_scale.x >= log_scale.y ? (log_scale.x >= log_scale.z ? 0 : 2)
                                              : (log_scale.y >= log_scale.z ? 1 : 2);
  ChildPlace child{Vec3f(0.0f), Vec3f(rules.across)};
  child.offset[axis] = side * rules.offset;
  child.scale[axis] = rules.along;
  return child;
}

/// The stored opacity of a child, and of a Gaussian that stays beside its copy or child.
///
///   factor (1 - (1 - o))
GS_HD float child_logit_opacity(float logit_opacity, const SplitRules& rules) {
  if (!rules.changes_opacity()) return logit_opacity;
  constexpr double kMost = 1 - double(kMinShareTransmittance);
  const double rest = 1 - sigmoid(double(logit_opacity));
  const double opacity = double(rules.opacity_factor) * (1 - rest);
  return float(logit(clamp_to(opacity, kMinChildOpacity, kMost)));
}

// ---- opacities ---------------------------------------------------------------------------------

/// One change of all opacities.
///
///   reset      min(o, amount)
///   halve      max(o / 2, amount)                                                       LiteGS
struct OpacityRule {
  OpacityPolicy policy = OpacityPolicy::none;
  float amount = 0;
  MomentClearing clears = MomentClearing::none;

  bool operator==(const OpacityRule&) const = default;
};

/// The stored opacity after the change. `logit_amount` is logit(amount), computed once for all.
GS_HD float lowered_logit_opacity(float logit_opacity, const OpacityRule& rule,
                                  float logit_amount) {
  switch (rule.policy) {
    case OpacityPolicy::none: break;
    case OpacityPolicy::reset: return min_of(logit_opacity, logit_amount);
    case OpacityPolicy::halve: return logit(max_of(0.5f * sigmoid(logit_opacity), rule.amount));
  }
  return logit_opacity;
}

// ---- counts ------------------------------------------------------------------------------------

/// How many Gaussians there may be in the end of a refinement; 0: any number.
///
///   none       B                            u    share of the refinement window that is over
///   linear     N_0 + (B - N_0) u            N_0  Gaussians at the start of the run
///   root       max(N_0, B sqrt u)           B    density.max_gaussians
///   parabola   N_0 + (B - N_0) (2 u - u^2)
///   ramp       N_0 + (B - N_0) / s^(2 - u)  s    r^(1 - u), falls from r = ramp_from to 1
///
/// The ramp is that of DashGaussian with pictures r times smaller at first. Its s follows the
/// spectrum of the photos; one that falls as 1 / frequency gives the s above.
inline std::int64_t growth_target(GrowthCurve curve, double u, std::int64_t first,
                                  std::int64_t budget, double ramp_from = 1) {
  const auto between = [&](double share) {
    return std::int64_t(std::llround(double(first) + double(budget - first) * share));
  };
  switch (curve) {
    case GrowthCurve::none: break;
    case GrowthCurve::linear: return between(u);
    case GrowthCurve::root:
      return max_of(first, std::int64_t(std::llround(std::sqrt(u) * double(budget))));
    case GrowthCurve::parabola: return between(u * (2 - u));
    case GrowthCurve::ramp: return between(std::pow(ramp_from, (u - 1) * (2 - u)));
  }
  return budget;
}

// ---- a refinement ------------------------------------------------------------------------------

/// The rules of one refinement. A Gaussian may grow if its mean gradient reaches
/// limits.gradient_threshold, its score reaches score_threshold and is above 0, and it is not
/// pruned. One that is replaced by its children need not pass the pruning; its children must.
struct GrowthRules {
  AdaptiveRules limits;  // max_gaussians: rows in the end; 0: any number
  GrowthScore score = GrowthScore::gradient;
  GrowthSelection select = GrowthSelection::top_k;
  float score_threshold = 0;
  float most_growth = 1;  // of the rows that stay
  bool prunes_unseen = false;
  SplitRules split = {};
};

/// What a refinement does with a row. A row that is cloned stays beside its copy; one that is split
/// is replaced by its children, or stays beside its only child (SplitRules::keeps_parent).
enum class GrowthAction : std::uint8_t { keep, clone, split, prune };
GS_HD bool grows(GrowthAction action) {
  return action == GrowthAction::clone || action == GrowthAction::split;
}
GS_HD bool survives(GrowthAction action, const GrowthRules& rules) {
  return action == GrowthAction::keep || action == GrowthAction::clone ||
         (action == GrowthAction::split && rules.split.keeps_parent);
}

/// The rules of rows whose actions are given: children that can be drawn stay.
inline GrowthRules rules_of_given(const SplitRules& split) {
  GrowthRules rules;
  rules.limits = {0, 0, 0, std::numeric_limits<float>::infinity(), 0};
  rules.split = split;
  return rules;
}

/// How many rows may be added to those that stay. One that is split counts as one that stays.
GS_HD std::int64_t allowed_growth(const GrowthRules& rules, std::int64_t staying) {
  const std::int64_t allowed = std::int64_t(double(rules.most_growth) * double(staying));
  if (rules.limits.max_gaussians <= 0) return allowed;
  return min_of(allowed, max_of<std::int64_t>(rules.limits.max_gaussians - staying, 0));
}

}  // namespace gs
