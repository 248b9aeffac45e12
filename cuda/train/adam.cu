// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam over every number of every learned quantity, from stored gradients. The fused
// update of preprocess_backward.cu takes its steps from adam_steps() below.
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

// One array of the model, and the sums of its gradients.
struct SummedArray {
  float *parameters, *m, *v, *sums;
  std::size_t size;              // numbers
  const std::uint32_t* touched;  // BatchSums
};

// Whether row `first` or one up to row `last` has gradients. Both are of the same 32 rows.
__device__ bool has_gradients(const std::uint32_t* touched, std::size_t first, std::size_t last) {
  return touched[first / kWarp] >> first % kWarp & ((2u << (last - first)) - 1);
}

// The same by sums, which it clears. A thread takes four numbers, which belong to the same 32 rows.
// Where their rows have no gradients, the sums need not be read. Of kInRow numbers of a row the
// first `in_use` are updated.
template <int kInRow>
__global__ void update_by_sums_kernel(SummedArray array, int in_use, AdamStep step, AdamRule rule,
                                      const std::uint32_t* halted) {
  const std::size_t first = 4 * (std::size_t(blockIdx.x) * kThreads + threadIdx.x);
  if (first >= array.size || *halted) return;
  const auto update = [&](std::size_t at, float& p, float& m, float& v, float gradient) {
    if (in_use == kInRow || int(at % kInRow) < in_use) adam_update(p, m, v, gradient, step, rule);
  };
  if (first + 4 <= array.size) {
    const bool is_touched = has_gradients(array.touched, first / kInRow, (first + 3) / kInRow);
    float4 p = *reinterpret_cast<float4*>(array.parameters + first);
    float4 m = *reinterpret_cast<float4*>(array.m + first);
    float4 v = *reinterpret_cast<float4*>(array.v + first);
    float4& sums = *reinterpret_cast<float4*>(array.sums + first);
    float4 gradient{0, 0, 0, 0};
    if (is_touched) gradient = sums;
    update(first, p.x, m.x, v.x, gradient.x);
    update(first + 1, p.y, m.y, v.y, gradient.y);
    update(first + 2, p.z, m.z, v.z, gradient.z);
    update(first + 3, p.w, m.w, v.w, gradient.w);
    *reinterpret_cast<float4*>(array.parameters + first) = p;
    *reinterpret_cast<float4*>(array.m + first) = m;
    *reinterpret_cast<float4*>(array.v + first) = v;
    if (is_touched) sums = float4{0, 0, 0, 0};
  } else {
    for (std::size_t i = first; i < array.size; ++i) {
      update(i, array.parameters[i], array.m[i], array.v[i], array.sums[i]);
      array.sums[i] = 0;
    }
  }
}

// After the updates: statistics += their sums, which are cleared. A warp has 32 rows with one word
// of marks, which it clears, too.
__global__ void add_statistics_kernel(Span<float> visits, float* gradient_norm, float* more_visits,
                                      float* more_norm, std::uint32_t* touched,
                                      const std::uint32_t* halted) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= visits.size || *halted) return;
  const std::uint32_t marks = touched[i / kWarp];
  if (!marks) return;
  if (marks >> lane_of_thread() & 1) {
    visits[i] += more_visits[i];
    gradient_norm[i] += more_norm[i];
    more_visits[i] = more_norm[i] = 0;
  }
  __syncwarp(__activemask());  // all have read the marks
  if (i % kWarp == 0) touched[i / kWarp] = 0;
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
        adam_steps(model.adam_steps += update.rule.steps, update.rates, update.rule));
  }

 private:
  Context& context_;
};

}  // namespace

AdamSteps adam_steps(int t, const LearningRates& rates, const AdamRule& rule) {
  AdamSteps steps;
  steps.has_time = steps.has_slope = true;
  for_each_array(
      [&](const char*, AdamStep& step, float rate) { step = adam_step(t, rate, rule.photo_beta2); },
      steps, rates);
  return steps;
}

void update_by_sums(Context& context, TrainingModel& model, const AdamSteps& steps,
                    const AdamRule& rule, int sh_degree, const std::uint32_t* halted,
                    const BatchSums& sums) {
  const StageScope scope(context, "adam");
  for_each_array(
      [&](const char*, auto& parameters, auto& m, auto& v, const auto& sum, const AdamStep& step) {
        constexpr int kInRow = int(sizeof(parameters[0]) / sizeof(float));
        const Span<float> numbers = numbers_of(parameters);
        if (numbers.empty()) return;
        const SummedArray array{numbers.data,         numbers_of(m).data, numbers_of(v).data,
                                numbers_of(sum).data, numbers.size,       sums.touched.data()};
        const int in_use = kInRow == 3 * kShRestCount ? 3 * sh_rest_count(sh_degree) : kInRow;
        context.launch("adam", update_by_sums_kernel<kInRow>,
                       blocks_for((numbers.size + 3) / 4, kThreads), kThreads, array, in_use, step,
                       rule, halted);
      },
      model.gaussians, model.first_moment, model.second_moment, sums.gradients, steps);
  context.launch("adam", add_statistics_kernel, blocks_for(model.count(), kThreads), kThreads,
                 model.statistics.visits.span(), model.statistics.gradient_norm.data(),
                 sums.statistics.visits.data(), sums.statistics.gradient_norm.data(),
                 sums.touched.data(), halted);
}

std::unique_ptr<Optimizer> make_optimizer(Context& context) {
  return std::make_unique<CudaOptimizer>(context);
}

}  // namespace gs::cuda
