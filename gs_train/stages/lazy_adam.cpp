// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam of SH where rows that no photo of an update sees are left for later; the formula is
// in gs_core/math/lazy_adam.h.
#include "gs_core/math/lazy_adam.h"

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

// The gradient of a number and the step of its quantity; without one, the number only catches up.
struct NoUpdate {
  void operator()(float&, float&, float&, LazyQuantity, int) const {}
};

// The numbers of row i of one array.
template <class Row>
float* row_of(const Buffer<Row>& rows, std::size_t i) {
  return numbers_of(rows).data + i * (sizeof(Row) / sizeof(float));
}

// Row i makes up for what it has missed. Then update(parameter, m, v, quantity, number in its row)
// is called for each number.
template <class UpdateNumber>
void catch_up_floats(const TrainingModel& model, std::size_t i, const CatchUp& missed,
                     const UpdateNumber& update) {
  for_each_lazy_array(
      [&]<class Row>(LazyQuantity quantity, const Buffer<Row>& rows, const auto& of_m,
                     const auto& of_v) {
        float *const p = row_of(rows, i), *const m = row_of(of_m, i), *const v = row_of(of_v, i);
        for (int k = 0; k < int(sizeof(Row) / sizeof(float)); ++k) {
          catch_up(p[k], m[k], v[k], missed, quantity);
          update(p[k], m[k], v[k], quantity, k);
        }
      },
      model.gaussians, model.first_moment, model.second_moment);
}

// The same with moments that are codes. They are rounded once, however many updates they have
// missed.
template <class Code, class UpdateNumber>
void catch_up_codes(const TrainingModel& model, std::size_t i, const CatchUp& missed,
                    const UpdateNumber& update, std::uint32_t random) {
  static const NumberPlaces kPlaces = number_places();
  for_each_lazy_array(
      [&]<class Row>(LazyQuantity quantity, const Buffer<Row>& rows, const auto& codes, int place) {
        float* const p = row_of(rows, i);
        for (int k = 0; k < int(sizeof(Row) / sizeof(float)); ++k) {
          Code& code = codes[i].number[k];
          float m = first_moment(code), v = second_moment(code);
          catch_up(p[k], m, v, missed, quantity);
          update(p[k], m, v, quantity, k);
          code = Code::of(m, v, random_of_number(random, place + k));
        }
      },
      model.gaussians, codes_in<Code>(model), kPlaces);
}

template <class UpdateNumber>
void catch_up_row(const TrainingModel& model, std::size_t i, const CatchUp& missed,
                  const UpdateNumber& update) {
  if (!are_codes(model.moment_form)) return catch_up_floats(model, i, missed, update);
  const MomentRounding rounding{model.lazy.rounding_seed, model.adam_steps};
  with_code(model.moment_form, [&]<class Code>(Code) {
    catch_up_codes<Code>(model, i, missed, update, rounding.of_row(i));
  });
}

}  // namespace

void update_sh_lazily(TrainingModel& model, const Gaussians& gradients, const Update& update,
                      const AdamSteps& steps) {
  LazyState& lazy = model.lazy;
  const Span<const std::uint8_t> seen = update.seen;
  GS_CHECK(seen.empty() || seen.size == model.count());
  GS_CHECK(lazy.updates < kLazyWindow);
  lazy.rounding_seed = update.rounding_seed;
  const LazySh before = lazy_sh_of(model);
  const AdamStep of_quantity[] = {steps.sh0, steps.sh_rest, steps.sh0_slope};
  parallel_for(model.count(), 512, [&](std::size_t i) {
    if (!seen.empty() && !seen[i]) return;
    const float* const gradient[] = {
        row_of(gradients.sh0, i), row_of(gradients.sh_rest, i),
        gradients.has_slope ? row_of(gradients.sh0_slope, i) : nullptr};
    catch_up_row(model, i, before.missed_by(i),
                 [&](float& p, float& m, float& v, LazyQuantity quantity, int k) {
                   adam_update(p, m, v, gradient[quantity][k], of_quantity[quantity], update.rule);
                 });
    lazy.updated_at[i] = std::uint32_t(lazy.updates) + 1;
  });
  const UnseenUpdate unseen = unseen_update(model.adam_steps, steps, update.rule);
  lazy.missed[std::size_t(lazy.updates++)] = MissedUpdates();
  for (int k = 0; k < lazy.updates; ++k) add_update(lazy.missed[std::size_t(k)], unseen);
  if (lazy.updates == kLazyWindow) catch_up(model);
}

void catch_up(TrainingModel& model) {
  LazyState& lazy = model.lazy;
  if (!lazy.is_on || lazy.updates == 0) return;
  const LazySh late = lazy_sh_of(model);
  parallel_for(model.count(), 512, [&](std::size_t i) {
    if (late.is_late(i)) catch_up_row(model, i, late.missed_by(i), NoUpdate());
    lazy.updated_at[i] = 0;
  });
  lazy.updates = 0;
}

void show_current_sh(const TrainingModel& model) {
  if (!model.lazy.is_on) return;
  const LazySh late = lazy_sh_of(model);
  parallel_for(model.count(), 512, [&](std::size_t i) {
    if (!late.is_late(i)) return;
    const CatchUp missed = late.missed_by(i);
    for_each_lazy_array(
        [&]<class Row>(LazyQuantity quantity, const Buffer<Row>& rows, const auto&... moments) {
          constexpr int kInRow = int(sizeof(Row) / sizeof(float));
          const MomentNumbers numbers = moment_numbers(late.moments.form, moments...);
          float* const p = row_of(rows, i);
          for (int k = 0; k < kInRow; ++k) {
            float m, v;
            numbers.load(i * kInRow + std::size_t(k), m, v);
            p[k] = caught_up(p[k], m, v, missed.length[quantity], missed.epsilon);
          }
        },
        model.gaussians, late.moments.first, late.moments.second, late.moments.compact,
        late.moments.tiny);
  });
}

}  // namespace gs
