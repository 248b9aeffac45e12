// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam over every number of every learned quantity, from stored gradients.
#include "cuda/device/warp.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // numbers are independent: any size that fills a multiprocessor

__global__ void adam_kernel(Span<float> parameters, Span<float> m, Span<float> v,
                            Span<const float> gradient, AdamStep step, AdamRule rule) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= parameters.size) return;
  adam_update(parameters[i], m[i], v[i], gradient[i], step, rule);
}

// The same with moments that are codes, for a quantity with so many numbers in a row. `place` is
// that of the quantity (NumberPlaces).
__global__ void adam_codes_kernel(Span<float> parameters, Span<TinyCode> moments,
                                  Span<const float> gradient, AdamStep step, AdamRule rule,
                                  MomentRounding rounding, int in_row, int place) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= parameters.size) return;
  adam_update(parameters[i], moments[i], gradient[i], step, rule,
              random_of_number(rounding.of_row(i / in_row), place + int(i % in_row)));
}

class CudaOptimizer final : public Optimizer {
 public:
  explicit CudaOptimizer(Context& context) : context_(context) {}

  void regularize(const TrainingModel& model, const Regularizers& regularizers,
                  Gaussians& gradients) override {
    add_regularizer_gradients(context_, model.gaussians.span(), regularizers, gradients.span());
  }
  void add_noise(TrainingModel& model, const PositionNoise& noise, float position_rate) override {
    add_position_noise(context_, model.gaussians.span(), noise, position_rate, nullptr);
  }
  void step(TrainingModel& model, const Gaussians& gradients, const Update& update) override {
    GS_CHECK(gradients.count() == model.count());
    StageScope scope(context_, "adam");
    const AdamRule& rule = update.rule;
    const int t = model.adam_steps += rule.steps;
    const AdamSteps steps = adam_steps(t, update.rates);
    if (model.moment_form == MomentForm::tiny)
      update_codes(model, gradients, steps, rule, {update.rounding_seed, t});
    else
      update_floats(model, gradients, steps, rule);
  }

 private:
  void update_floats(const TrainingModel& model, const Gaussians& gradients, const AdamSteps& steps,
                     const AdamRule& rule) {
    for_each_array(
        [&](const char*, const auto& parameters, const auto& m, const auto& v, const auto& gradient,
            const AdamStep& step) {
          const Span<float> numbers = numbers_of(parameters);
          context_.launch("adam", adam_kernel, blocks_for(numbers.size, kThreads), kThreads,
                          numbers, numbers_of(m), numbers_of(v), numbers_of(gradient), step, rule);
        },
        model.gaussians, model.first_moment, model.second_moment, gradients, steps);
  }
  void update_codes(const TrainingModel& model, const Gaussians& gradients, const AdamSteps& steps,
                    const AdamRule& rule, const MomentRounding& rounding) {
    for_each_array(
        [&](const char*, const auto& parameters, const auto& moments, const auto& gradient,
            const AdamStep& step, int place) {
          const Span<float> numbers = numbers_of(parameters);
          context_.launch("adam", adam_codes_kernel, blocks_for(numbers.size, kThreads), kThreads,
                          numbers, codes_of(moments), numbers_of(gradient), step, rule, rounding,
                          int(sizeof(parameters[0]) / sizeof(float)), place);
        },
        model.gaussians, model.codes, gradients, steps, number_places());
  }

  Context& context_;
};

}  // namespace

std::unique_ptr<Optimizer> make_optimizer(Context& context) {
  return std::make_unique<CudaOptimizer>(context);
}

}  // namespace gs::cuda
