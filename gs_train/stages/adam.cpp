// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam over every number of every learned quantity, visible or not.
#include "gs_core/math/update/adam.h"

#include "gs_core/error.h"
#include "gs_core/math/update/moment_rounding.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

template <class Stored>
void update_row(TrainingModel& model, AdamMoments<Stored>& moments, std::size_t i,
                const Gaussians& gradients, const AdamSteps& steps, const AdamRule& rule,
                std::uint32_t random) {
  for_each_array(
      [&](const char*, auto& rows, auto& of_moments, const auto& of_gradients, const AdamStep& step,
          int offset) {
        constexpr int kInRow = sizeof(rows[0]) / sizeof(float);
        float* const parameters = numbers_of(rows).data + i * kInRow;
        const float* const gradient = numbers_of(of_gradients).data + i * kInRow;
        for (int k = 0; k < kInRow; ++k)
          adam_update(parameters[k], of_moments[i].number[k], gradient[k], step, rule,
                      random_of_number(random, offset + k));
      },
      model.gaussians, moments, gradients, steps, kRandomOffsets);
}

}  // namespace

void update_by_adam(TrainingModel& model, const Gaussians& gradients, const Update& update) {
  const HostStage stage("adam");
  GS_CHECK(gradients.count() == model.count());
  const AdamRule& rule = update.rule;
  const int t = model.adam_steps += rule.steps;
  const AdamSteps steps = adam_steps(t, update.rates);
  const MomentRounding rounding{update.rounding_seed, t};
  std::visit(
      [&]<class Stored>(AdamMoments<Stored>& moments) {
        parallel_for(model.count(), 512, [&](std::size_t i) {
          const std::uint32_t random = Stored::kIsRounded ? rounding.of_row(i) : 0;
          update_row(model, moments, i, gradients, steps, rule, random);
        });
      },
      model.moments);
}

}  // namespace gs
