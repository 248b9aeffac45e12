// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam over every number of every learned quantity, from stored gradients. The fused
// update of preprocess_backward.cu takes its steps from adam_steps() below.
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

// The same by sums, which it clears. Of `in_row` numbers of a row the first `in_use` are updated.
__global__ void update_by_sums_kernel(Span<float> parameters, Span<float> m, Span<float> v,
                                      float* sums, int in_row, int in_use, AdamStep step,
                                      AdamRule rule, const std::uint32_t* halted) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= parameters.size || *halted || int(i % in_row) >= in_use) return;
  adam_update(parameters[i], m[i], v[i], sums[i], step, rule);
  sums[i] = 0;
}

__global__ void add_statistics_kernel(Span<float> visits, float* gradient_norm, float* more_visits,
                                      float* more_norm, const std::uint32_t* halted) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= visits.size || *halted) return;
  visits[i] += more_visits[i];
  gradient_norm[i] += more_norm[i];
  more_visits[i] = more_norm[i] = 0;
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
    for_each_array(
        [&](const char*, auto& parameters, auto& m, auto& v, const auto& gradient,
            const AdamStep& step) {
          const Span<float> numbers = numbers_of(parameters);
          context_.launch("adam", adam_kernel, blocks_for(numbers.size, kThreads), kThreads,
                          numbers, numbers_of(m), numbers_of(v), numbers_of(gradient), step,
                          update.rule);
        },
        model.gaussians, model.first_moment, model.second_moment, gradients,
        adam_steps(model.adam_steps += update.rule.steps, update.rates));
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

void update_by_sums(Context& context, TrainingModel& model, const AdamSteps& steps,
                    const AdamRule& rule, int sh_degree, const std::uint32_t* halted,
                    const BatchSums& sums) {
  const StageScope scope(context, "adam");
  for_each_array(
      [&](const char*, auto& parameters, auto& m, auto& v, auto& sum, const AdamStep& step) {
        const Span<float> numbers = numbers_of(parameters);
        if (numbers.empty()) return;
        const int in_row = int(numbers.size / model.count());
        const bool is_sh_rest = in_row == 3 * kShRestCount;
        const int in_use = is_sh_rest ? 3 * sh_rest_count(sh_degree) : in_row;
        context.launch("adam", update_by_sums_kernel, blocks_for(numbers.size, kThreads), kThreads,
                       numbers, numbers_of(m), numbers_of(v), numbers_of(sum).data, in_row, in_use,
                       step, rule, halted);
      },
      model.gaussians, model.first_moment, model.second_moment, sums.gradients, steps);
  context.launch("adam", add_statistics_kernel, blocks_for(model.count(), kThreads), kThreads,
                 model.statistics.visits.span(), model.statistics.gradient_norm.data(),
                 sums.statistics.visits.data(), sums.statistics.gradient_norm.data(), halted);
}

std::unique_ptr<Optimizer> make_optimizer(Context& context) {
  return std::make_unique<CudaOptimizer>(context);
}

}  // namespace gs::cuda
