// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam over every number of every learned quantity, visible or not.
#include "gs_core/math/adam.h"

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

class ScalarOptimizer final : public Optimizer {
 public:
  void regularize(const TrainingModel& model, const Regularizers& regularizers,
                  Gaussians& gradients) override {
    const HostStage stage("regularizers");
    add_regularizer_gradients(model.gaussians.span(), regularizers.of_each(model.count()),
                              gradients.span());
  }
  void add_noise(TrainingModel& model, const PositionNoise& noise, float position_rate) override {
    const HostStage stage("position noise");
    add_position_noise(model.gaussians.span(), noise, position_rate);
  }
  void step(TrainingModel& model, const Gaussians& gradients, const Update& update) override {
    const HostStage stage("adam");
    update_by_adam(model, gradients, update, [](std::size_t row) { return row; });
  }
};

void update_numbers(Span<float> parameters, Span<float> m, Span<float> v,
                    Span<const float> gradient, const AdamStep& step, const AdamRule& rule) {
  parallel_chunks(parameters.size, 16384, [=](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      adam_update(parameters[i], m[i], v[i], gradient[i], step, rule);
  });
}

void update_floats(TrainingModel& model, const Gaussians& gradients, const AdamSteps& steps,
                   const AdamRule& rule) {
  for_each_array(
      [&](const char*, auto& parameters, auto& m, auto& v, const auto& gradient,
          const AdamStep& step) {
        update_numbers(numbers_of(parameters), numbers_of(m), numbers_of(v), numbers_of(gradient),
                       step, rule);
      },
      model.gaussians, model.first_moment, model.second_moment, gradients, steps);
}

// Row i, whose moments are codes.
void update_row(TrainingModel& model, std::size_t i, const Gaussians& gradients,
                const AdamSteps& steps, const AdamRule& rule, std::uint32_t random) {
  static const NumberPlaces kPlaces = number_places();
  for_each_array(
      [&](const char*, auto& rows, auto& moments, const auto& of_rows, const AdamStep& step,
          int place) {
        constexpr int kInRow = sizeof(rows[0]) / sizeof(float);
        float* const parameters = numbers_of(rows).data + i * kInRow;
        const float* const gradient = numbers_of(of_rows).data + i * kInRow;
        for (int k = 0; k < kInRow; ++k)
          adam_update(parameters[k], moments[i].number[k], gradient[k], step, rule,
                      random_of_number(random, place + k));
      },
      model.gaussians, model.codes, gradients, steps, kPlaces);
}

}  // namespace

void update_by_adam(TrainingModel& model, const Gaussians& gradients, const Update& update,
                    const std::function<std::size_t(std::size_t)>& row_of_model) {
  GS_CHECK(gradients.count() == model.count());
  const AdamRule& rule = update.rule;
  const int t = model.adam_steps += rule.steps;
  const AdamSteps steps = adam_steps(t, update.rates);
  const MomentRounding rounding{update.rounding_seed, t};
  if (model.moment_form == MomentForm::tiny)
    parallel_for(model.count(), 512, [&](std::size_t i) {
      update_row(model, i, gradients, steps, rule, rounding.of_row(row_of_model(i)));
    });
  else
    update_floats(model, gradients, steps, rule);
}

std::unique_ptr<Optimizer> make_scalar_optimizer() { return std::make_unique<ScalarOptimizer>(); }

}  // namespace gs
