// SPDX-License-Identifier: Apache-2.0
// Stage 9 for row i of the Gaussians, as both backends apply it: who is pruned, what splitting
// makes, who is drawn. The formulas are in gs_core/math/density/density.h, mcmc.h and
// spacetime_density.h.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/math/density/growth.h"
#include "gs_core/math/density/mcmc.h"
#include "gs_core/math/density/race.h"
#include "gs_core/math/density/spacetime_density.h"
#include "gs_core/math/density/spacetime_regularizer.h"
#include "gs_core/math/render/filter_3d.h"
#include "gs_train/update.h"

namespace gs {

/// True where rows have times and those of the row cannot be used: it would never be visible.
GS_HD bool is_never_visible(const GaussiansSpan& rows, std::size_t i, float time_mean,
                            float log_time_scale) {
  return rows.has_time && !is_ever_visible(rows.right_rotation[i], time_mean, log_time_scale);
}
GS_HD bool is_never_visible(const GaussiansSpan& rows, std::size_t i) {
  return rows.has_time && is_never_visible(rows, i, rows.time_mean[i], rows.log_time_scale[i]);
}

/// The share of the opacity that the row's 3D filter would leave at these scales; 1 without one.
GS_HD float filter_share(const GaussiansSpan& rows, std::size_t i, const Vec3f& log_scale) {
  return rows.has_filter ? filter_factor(variance(log_scale), rows.filter_scale[i]) : 1.0f;
}

/// The rules for a row of which a filter leaves a share of the opacity: what is drawn counts.
GS_HD AdaptiveRules with_filter_share(AdaptiveRules rules, float share) {
  rules.prune_opacity /= share;
  return rules;
}

/// The row's stored opacity after it is lowered so that at most `opacity` of it is drawn.
GS_HD float capped_logit_opacity(const GaussiansSpan& rows, std::size_t i, float opacity) {
  const float share = filter_share(rows, i, rows.log_scale[i]);
  const float highest = min_of(opacity / share, kMostStoredOpacity);
  return min_of(rows.logit_opacity[i], logit(highest));
}

/// True if the row can never be visible: transparent, without a rotation, or not finite.
GS_HD bool is_invisible(const GaussiansSpan& rows, std::size_t i, float min_opacity) {
  return is_invisible(rows.mean[i], rows.log_scale[i], rows.rotation[i], rows.logit_opacity[i],
                      min_opacity / filter_share(rows, i, rows.log_scale[i])) ||
         is_never_visible(rows, i);
}

/// True if a refinement removes the row: it cannot be visible, or it is too large.
GS_HD bool is_pruned(const GaussiansSpan& rows, std::size_t i, const AdaptiveRules& rules) {
  return is_pruned(rows.mean[i], rows.log_scale[i], rows.rotation[i], rows.logit_opacity[i],
                   with_filter_share(rules, filter_share(rows, i, rows.log_scale[i]))) ||
         is_never_visible(rows, i);
}

/// The row's weight in the draw of sources for copies; see draw_weight() in mcmc.h. A live row
/// outside of the region weighs 1 in 2^24: it is not dead, and is hardly ever drawn.
GS_HD std::uint32_t draw_weight(const GaussiansSpan& rows, std::size_t i, float dead_opacity,
                                const Region& region = {}) {
  if (is_invisible(rows, i, 0.0f)) return 0;
  const std::uint32_t weight = draw_weight(rows.logit_opacity[i], dead_opacity);
  return region.holds(rows.mean[i]) ? weight : min_of(weight, std::uint32_t(1));
}

/// The values of a row that splitting changes. Those of time are 0 where rows have no time.
struct HalfRow {
  Vec3f mean, log_scale;
  float time_mean = 0, log_time_scale = 0;
};

/// Half `number` of all halves of a step, from a row that has its parent's values: moved by a draw
/// of its own, and shrunk.
GS_HD HalfRow half_of(const GaussiansSpan& rows, std::size_t i, std::uint32_t number,
                      const Random& random, int step) {
  const Vec4f normal = random.normal4(std::uint64_t(step), number);
  const Vec3f& log_scale = rows.log_scale[i];
  HalfRow half;
  half.log_scale = split_log_scale(log_scale);
  if (!rows.has_time) {
    half.mean =
        split_mean(rows.mean[i], log_scale, rows.rotation[i], {normal.x, normal.y, normal.z});
    return half;
  }
  const QuatPair<float> rotations{rows.rotation[i], rows.right_rotation[i]};
  const float log_time_scale = rows.log_time_scale[i];
  const Vec4f moved = within_the_scene(split_move(rotations, log_scale, log_time_scale, normal),
                                       rotations, log_scale, log_time_scale, rows.time_mean[i]);
  half.mean = rows.mean[i] + Vec3f(moved.x, moved.y, moved.z);
  half.time_mean = rows.time_mean[i] + moved.w;
  half.log_time_scale = split_log_time_scale(log_time_scale);
  return half;
}

/// True if a refinement removes the half at once.
GS_HD bool is_pruned(const HalfRow& half, const GaussiansSpan& rows, std::size_t parent,
                     const AdaptiveRules& rules) {
  return is_pruned(half.mean, half.log_scale, rows.rotation[parent], rows.logit_opacity[parent],
                   with_filter_share(rules, filter_share(rows, parent, half.log_scale))) ||
         is_never_visible(rows, parent, half.time_mean, half.log_time_scale);
}

/// The row's parameters without color.
GS_HD SpacetimeShape<float> spacetime_shape_of(const GaussiansSpan& rows, std::size_t i) {
  return {rows.mean[i],          rows.log_scale[i], {rows.rotation[i], rows.right_rotation[i]},
          rows.logit_opacity[i], rows.time_mean[i], rows.log_time_scale[i]};
}

/// Gives a row that has its parent's values those of the half.
GS_HD void write_half(const GaussiansSpan& rows, std::size_t i, const HalfRow& half) {
  rows.mean[i] = half.mean;
  rows.log_scale[i] = half.log_scale;
  if (!rows.has_time) return;
  rows.time_mean[i] = half.time_mean;
  rows.log_time_scale[i] = half.log_time_scale;
}

// ---- growth: growth.h ----------------------------------------------------------------------------

/// The statistics of density control as kernels take them; `sums` is null where there are none.
struct StatisticsSpan {
  const float* visits;
  const float* gradient_norm;
  const FragmentSums* sums;

  GS_HD FragmentSums sums_of(std::size_t i) const { return sums ? sums[i] : FragmentSums{}; }
};
inline StatisticsSpan span_of(const DensityStatistics& statistics) {
  return {statistics.visits.data(), statistics.gradient_norm.data(),
          statistics.has_sums ? statistics.sums.data() : nullptr};
}

/// The row's action if it may not grow.
GS_HD GrowthAction action_without_growth(const GaussiansSpan& rows,
                                         const StatisticsSpan& statistics, std::size_t i,
                                         const GrowthRules& rules) {
  const bool is_unseen = rules.prunes_unseen && !(statistics.sums_of(i).count > 0);
  return is_unseen || is_pruned(rows, i, rules.limits) ? GrowthAction::prune : GrowthAction::keep;
}

/// The row's action if every row may grow that passes.
GS_HD GrowthAction growth_action(const GaussiansSpan& rows, const StatisticsSpan& statistics,
                                 std::size_t i, const GrowthRules& rules) {
  const float visits = statistics.visits[i], norm = statistics.gradient_norm[i];
  const double score = growth_score(rules.score, visits, norm, statistics.sums_of(i));
  const bool passes = rules.limits.region.holds(rows.mean[i]) &&
                      wants_growth(visits, norm, rules.limits.gradient_threshold) &&
                      has_score(score) && score >= double(rules.score_threshold);
  const bool splits = passes && !is_small(rows.log_scale[i], rules.limits.small_scale);
  // A row too large to keep may still be split into children that are not.
  if (splits && !rules.split.keeps_parent) return GrowthAction::split;
  const GrowthAction without = action_without_growth(rows, statistics, i, rules);
  if (!passes || without == GrowthAction::prune) return without;
  return splits ? GrowthAction::split : GrowthAction::clone;
}

/// The row's key: of all rows that may grow, those with the smallest keys do.
GS_HD std::uint64_t growth_key(const StatisticsSpan& statistics, std::size_t i,
                               const GrowthRules& rules, const Random& random, int step) {
  const double score = growth_score(rules.score, statistics.visits[i], statistics.gradient_norm[i],
                                    statistics.sums_of(i));
  if (rules.select == GrowthSelection::top_k) return top_key(score);
  const RandomBits bits = random.bits(std::uint64_t(step), std::uint32_t(i));
  return race_key(std::uint64_t(bits.word[1]) << 32 | bits.word[0], score);
}

/// The values of a row that make it a child of its parent.
struct ChildRow {
  HalfRow half;
  float logit_opacity;
};

/// Child `number` of all children of a step, from a row that has its parent's values. Parents that
/// are replaced have two in a row, one on either side.
GS_HD ChildRow child_of(const GaussiansSpan& rows, std::size_t i, std::uint32_t number,
                        const SplitRules& rules, const Random& random, int step) {
  ChildRow child;
  child.logit_opacity = child_logit_opacity(rows.logit_opacity[i], rules);
  if (rules.place == SplitPlacement::draw) {
    child.half = half_of(rows, i, number, random, step);
    return child;
  }
  using std::log;
  const Vec3f& log_scale = rows.log_scale[i];
  const float side = number % 2 == 0 ? 1.0f : -1.0f;
  const ChildPlace place = child_on_axis(log_scale, rules, side);
  child.half.log_scale =
      log_scale + Vec3f(log(place.scale.x), log(place.scale.y), log(place.scale.z));
  if (!rows.has_time) {
    child.half.mean = split_mean(rows.mean[i], log_scale, rows.rotation[i], place.offset);
    return child;
  }
  const Vec4f offset(place.offset.x, place.offset.y, place.offset.z, 0.0f);
  const Vec4f moved = split_move(QuatPair<float>{rows.rotation[i], rows.right_rotation[i]},
                                 log_scale, rows.log_time_scale[i], offset);
  child.half.mean = rows.mean[i] + Vec3f(moved.x, moved.y, moved.z);
  child.half.time_mean = rows.time_mean[i] + moved.w;
  child.half.log_time_scale = rows.log_time_scale[i];
  return child;
}

/// True if a refinement removes the child at once.
GS_HD bool is_pruned(const ChildRow& child, const GaussiansSpan& rows, std::size_t parent,
                     const AdaptiveRules& rules) {
  const HalfRow& half = child.half;
  return is_pruned(half.mean, half.log_scale, rows.rotation[parent], child.logit_opacity,
                   with_filter_share(rules, filter_share(rows, parent, half.log_scale))) ||
         is_never_visible(rows, parent, half.time_mean, half.log_time_scale);
}

/// Gives a row that has its parent's values those of the child.
GS_HD void write_child(const GaussiansSpan& rows, std::size_t i, const ChildRow& child) {
  write_half(rows, i, child.half);
  rows.logit_opacity[i] = child.logit_opacity;
}

/// gradients += those of spacetime_regularizer().
GS_HD void add_spacetime_regularizer_gradients(const GaussiansSpan& rows, std::size_t i,
                                               const Regularizers& of_each,
                                               const GaussiansSpan& gradients) {
  SpacetimeShape<float> dL = spacetime_shape_of(gradients, i);
  add_spacetime_regularizer_vjp(spacetime_shape_of(rows, i), of_each, dL);
  gradients.log_scale[i] = dL.log_scale;
  gradients.rotation[i] = dL.rotations.left;
  gradients.right_rotation[i] = dL.rotations.right;
  gradients.log_time_scale[i] = dL.log_time_scale;
}

/// The noise on the row's mean after a step; see position_noise() in mcmc.h. A Gaussian in space and
/// time moves along its extent in space. Its draw is that of row `drawn` of the whole model, which
/// is i unless `rows` are a part of it.
GS_HD Vec3f position_noise(const GaussiansSpan& rows, std::size_t i, const PositionNoise& noise,
                           float position_rate, std::size_t drawn) {
  const float rate = noise.scale * position_rate;
  const Vec3f normal = noise.normal(drawn);
  if (!rows.has_time)
    return position_noise(rows.log_scale[i], rows.rotation[i], rows.logit_opacity[i], normal, rate);
  const SpacetimeShape<float> shape = spacetime_shape_of(rows, i);
  if (is_degenerate(shape.rotations)) return Vec3f(0.0f);
  return position_noise(covariance(shape).space, shape.logit_opacity, normal, rate);
}
GS_HD Vec3f position_noise(const GaussiansSpan& rows, std::size_t i, const PositionNoise& noise,
                           float position_rate) {
  return position_noise(rows, i, noise, position_rate, i);
}

}  // namespace gs
