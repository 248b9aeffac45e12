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
    GS_CHECK(gradients.count() == model.count());
    const int t = model.adam_steps += update.rule.steps;
    for_each_array(
        [&](const char*, auto& parameters, auto& m, auto& v, const auto& gradient, float rate) {
          update_numbers(numbers_of(parameters), numbers_of(m), numbers_of(v), numbers_of(gradient),
                         adam_step(t, rate, update.rule.photo_beta2), update.rule);
        },
        model.gaussians, model.first_moment, model.second_moment, gradients, update.rates);
  }

 private:
  static void update_numbers(Span<float> parameters, Span<float> m, Span<float> v,
                             Span<const float> gradient, const AdamStep& step,
                             const AdamRule& rule) {
    parallel_chunks(parameters.size, 16384, [=](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i)
        adam_update(parameters[i], m[i], v[i], gradient[i], step, rule);
    });
  }
};

}  // namespace

std::unique_ptr<Optimizer> make_scalar_optimizer() { return std::make_unique<ScalarOptimizer>(); }

}  // namespace gs
