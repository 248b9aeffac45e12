// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam over every number of every learned quantity, from stored gradients.
#include "cuda/device/warp.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // numbers are independent: any size that fills a multiprocessor

// One quantity, with so many numbers in a row.
template <class Stored>
__global__ void adam_kernel(Span<float> parameters, Span<Stored> moments,
                            Span<const float> gradient, AdamStep step, AdamRule rule,
                            MomentRounding rounding, int in_row, int random_offset) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= parameters.size) return;
  std::uint32_t random = 0;
  if constexpr (Stored::kIsRounded)
    random = random_of_number(rounding.of_row(i / in_row), random_offset + int(i % in_row));
  adam_update(parameters[i], moments[i], gradient[i], step, rule, random);
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
    const MomentRounding rounding{update.rounding_seed, t};
    std::visit(
        [&]<class Stored>(const AdamMoments<Stored>& moments) {
          for_each_array(
              [&](const char*, const auto& parameters, const auto& of_parameters,
                  const auto& gradient, const AdamStep& step, int random_offset) {
                const Span<float> numbers = numbers_of(parameters);
                context_.launch("adam", adam_kernel<Stored>, blocks_for(numbers.size, kThreads),
                                kThreads, numbers, moments_in(of_parameters), numbers_of(gradient),
                                step, rule, rounding, int(sizeof(parameters[0]) / sizeof(float)),
                                random_offset);
              },
              model.gaussians, moments, gradients, steps, kRandomOffsets);
        },
        model.moments);
  }

 private:
  Context& context_;
};

}  // namespace

std::unique_ptr<Optimizer> make_optimizer(Context& context) {
  return std::make_unique<CudaOptimizer>(context);
}

}  // namespace gs::cuda
