// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam of rows that no photo of an update sees, left for later. Nothing reads the SH of
// such a row, and its gradient is zero. So the row stays as it is, with the number of the last
// update that it has had, until a photo sees it. Then it makes up for all updates that it has
// missed at once.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/math/adam.h"
#include "gs_core/math/moment_code.h"

namespace gs {

/// Updates after which all rows are brought up to date, if nothing has asked for it before. It
/// bounds the table of MissedUpdates.
inline constexpr int kLazyWindow = 1024;

/// The quantities that are updated lazily: those of color.
enum LazyQuantity { kLazySh0, kLazyShRest, kLazySh0Slope };
inline constexpr int kLazyQuantities = 3;

/// One update, as it is for a number without a gradient.
struct UnseenUpdate {
  double beta1, beta2;
  double length[kLazyQuantities];  // rate sqrt(1 - b2^t), rate with its bias correction
  double weight;                   // the same for a learning rate of 1
  double epsilon;                  // epsilon sqrt(1 - b2^t)
};
inline UnseenUpdate unseen_update(int t, const AdamStep& sh0, const AdamStep& sh_rest,
                                  const AdamStep& sh0_slope, const AdamRule& rule) {
  const AdamStep unit = adam_step(t, 1.0f, rule.photo_beta2);
  const double root = 1.0 / double(unit.inverse_sqrt_bias2);
  return {rule.beta1,
          rule.beta2,
          {sh0.rate * root, sh_rest.rate * root, sh0_slope.rate * root},
          unit.rate * root,
          double(rule.epsilon) * root};
}

/// What makes up for some updates that a row has missed. By default there are none.
struct CatchUp {
  float m_decay = 1, v_decay = 1;
  float epsilon = kAdamEpsilon;
  float length[kLazyQuantities] = {};
};

/// Updates t0+1 .. t1 of numbers without gradients, as sums that the next update extends:
///
///   m_j = m B1_j,  v_j = v B2_j                 B1_j, B2_j  products of the betas from t0 to j
///   p  -= sum_j rate_j m_j / (sqrt(v_j) / sqrt(1 - b2^j) + eps)
///       = m sum_j l_j / (sqrt(v) + e_j)         l_j = rate_j sqrt(1 - b2^j) B1_j / sqrt(B2_j)
///                                               e_j = eps   sqrt(1 - b2^j)       / sqrt(B2_j)
///      ~= m L / (sqrt(v) + E)                   L = sum l_j,  E = sum l_j e_j / L
///
/// E is the mean of the e_j by which the update is right to the first order in e_j / sqrt(v). It
/// also holds where v is zero or tiny. What is left of the error is in docs/lazy_adam.md.
struct MissedUpdates {
  double m_decay = 1, v_decay = 1;
  double length[kLazyQuantities] = {};
  double weight = 0, epsilon_sum = 0;  // E is the same for all quantities
  CatchUp catch_up;                    // the result
};
/// The result, from the sums.
GS_HD void find_catch_up(MissedUpdates& missed) {
  CatchUp& result = missed.catch_up;
  result.m_decay = float(missed.m_decay);
  result.v_decay = float(missed.v_decay);
  result.epsilon = float(missed.epsilon_sum / missed.weight);
  for (int q = 0; q < kLazyQuantities; ++q) result.length[q] = float(missed.length[q]);
}
GS_HD void add_update(MissedUpdates& missed, const UnseenUpdate& update) {
  using std::sqrt;
  missed.m_decay *= update.beta1;
  missed.v_decay *= update.beta2;
  const double root = sqrt(missed.v_decay), share = missed.m_decay / root;
  missed.weight += update.weight * share;
  missed.epsilon_sum += update.weight * share * (update.epsilon / root);
  for (int q = 0; q < kLazyQuantities; ++q) missed.length[q] += update.length[q] * share;
  find_catch_up(missed);
}

/// A parameter after the updates that it has missed, from its moments before them.
GS_HD float caught_up(float parameter, float m, float v, float length, float epsilon) {
  using std::sqrt;
  return parameter - m * length / (sqrt(v) + epsilon);
}
/// The same with its moments.
GS_HD void catch_up(float& parameter, float& m, float& v, const CatchUp& missed, int quantity) {
  parameter = caught_up(parameter, m, v, missed.length[quantity], missed.epsilon);
  m *= missed.m_decay;
  v *= missed.v_decay;
}

/// SH of a model's rows that may be late: what a renderer needs to draw it as it is now.
struct LazySh {
  std::uint32_t updates = 0;                  // since all rows were up to date
  const std::uint32_t* updated_at = nullptr;  // (N)  the last of these that each row has had
  const MissedUpdates* missed = nullptr;      // (updates)  those after each of these
  MomentsSpan moments;

  GS_HD bool is_late(std::size_t row) const { return updated_at[row] < updates; }
  GS_HD CatchUp missed_by(std::size_t row) const {
    return is_late(row) ? missed[updated_at[row]].catch_up : CatchUp();
  }
};

/// Calls f(LazyQuantity, a.array, b.array, ...) for each quantity that is updated lazily and that
/// `first` has.
template <class F, class First, class... Rest>
void for_each_lazy_array(F&& f, First&& first, Rest&&... rest) {
  f(kLazySh0, first.sh0, rest.sh0...);
  f(kLazyShRest, first.sh_rest, rest.sh_rest...);
  if (first.has_slope) f(kLazySh0Slope, first.sh0_slope, rest.sh0_slope...);
}
/// Calls f(name, a.array, b.array, ...) for each of the others, on which it depends what a photo
/// sees.
template <class F, class First, class... Rest>
void for_each_prompt_array(F&& f, First&& first, Rest&&... rest) {
  f("mean", first.mean, rest.mean...);
  f("log_scale", first.log_scale, rest.log_scale...);
  f("rotation", first.rotation, rest.rotation...);
  f("logit_opacity", first.logit_opacity, rest.logit_opacity...);
  if (!first.has_time) return;
  f("right_rotation", first.right_rotation, rest.right_rotation...);
  f("time_mean", first.time_mean, rest.time_mean...);
  f("log_time_scale", first.log_time_scale, rest.log_time_scale...);
}

}  // namespace gs
