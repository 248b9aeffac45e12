// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam over every number of every learned quantity, from stored gradients. The fused
// update of preprocess_backward.cu takes its steps from adam_steps() below.
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // numbers are independent: any size that fills a multiprocessor

__global__ void adam_kernel(Span<float> parameters, Span<float> m, Span<float> v,
                            Span<const float> gradient, AdamStep step) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= parameters.size) return;
  adam_update(parameters[i], m[i], v[i], gradient[i], step);
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
  void step(TrainingModel& model, const Gaussians& gradients, const LearningRates& rates) override {
    GS_CHECK(gradients.count() == model.count());
    StageScope scope(context_, "adam");
    for_each_array(
        [&](const char*, auto& parameters, auto& m, auto& v, const auto& gradient,
            const AdamStep& step) {
          const Span<float> numbers = numbers_of(parameters);
          context_.launch("adam", adam_kernel, blocks_for(numbers.size, kThreads), kThreads,
                          numbers, numbers_of(m), numbers_of(v), numbers_of(gradient), step);
        },
        model.gaussians, model.first_moment, model.second_moment, gradients,
        adam_steps(++model.adam_steps, rates));
  }

 private:
  Context& context_;
};

}  // namespace

AdamSteps adam_steps(int t, const LearningRates& rates) {
  AdamSteps steps;
  steps.has_time = true;
  for_each_array([&](const char*, AdamStep& step, float rate) { step = adam_step(t, rate); }, steps,
                 rates);
  return steps;
}

std::unique_ptr<Optimizer> make_optimizer(Context& context) {
  return std::make_unique<CudaOptimizer>(context);
}

}  // namespace gs::cuda
