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

// The same with moments that are codes. `place` is that of the quantity (NumberPlaces).
template <int kInRow>
__global__ void adam_codes_kernel(Span<float> parameters, Span<TinyCode> moments,
                                  Span<const float> gradient, AdamStep step, AdamRule rule,
                                  MomentRounding rounding, int place) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= parameters.size) return;
  adam_update(parameters[i], moments[i], gradient[i], step, rule,
              random_of_number(rounding.of_row(i / kInRow), place + int(i % kInRow)));
}

// One array of the model, and the sums of its gradients.
struct SummedArray {
  float *parameters, *m, *v, *sums;
  std::size_t size;              // numbers
  const std::uint32_t* touched;  // BatchSums; null: all rows
};

// Whether row `first` or one up to row `last` has gradients. Both are of the same 32 rows.
__device__ bool has_gradients(const std::uint32_t* touched, std::size_t first, std::size_t last) {
  return !touched || touched[first / kWarp] >> first % kWarp & ((2u << (last - first)) - 1);
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

// The same for an array whose moments are codes.
struct SummedCodes {
  float* parameters;
  TinyCode* moments;
  float* sums;
  std::size_t size;              // numbers
  const std::uint32_t* touched;  // BatchSums
  MomentRounding rounding;
  int place;  // NumberPlaces
  Shard shard;
};

template <int kInRow>
__global__ void update_codes_by_sums_kernel(SummedCodes array, int in_use, AdamStep step,
                                            AdamRule rule, const std::uint32_t* halted) {
  const std::size_t first = 4 * (std::size_t(blockIdx.x) * kThreads + threadIdx.x);
  if (first >= array.size || *halted) return;
  std::size_t row = first / kInRow;
  const auto random_of = [&](std::size_t i) {
    return array.rounding.of_row(array.shard.row_of_all(i));
  };
  std::uint32_t of_row = random_of(row);
  const auto update = [&](std::size_t at, float& p, TinyCode& moments, float gradient) {
    if (at / kInRow != row) of_row = random_of(row = at / kInRow);
    const int number = int(at - row * kInRow);
    if (number < in_use)
      adam_update(p, moments, gradient, step, rule, random_of_number(of_row, array.place + number));
  };
  if (first + 4 <= array.size) {
    const bool is_touched = has_gradients(array.touched, first / kInRow, (first + 3) / kInRow);
    float4 p = *reinterpret_cast<float4*>(array.parameters + first);
    ushort4 codes = *reinterpret_cast<ushort4*>(array.moments + first);
    float4& sums = *reinterpret_cast<float4*>(array.sums + first);
    float4 gradient{0, 0, 0, 0};
    if (is_touched) gradient = sums;
    const auto update_code = [&](std::size_t at, float& of_p, unsigned short& code,
                                 float of_gradient) {
      TinyCode moments{code};
      update(at, of_p, moments, of_gradient);
      code = moments.bits;
    };
    update_code(first, p.x, codes.x, gradient.x);
    update_code(first + 1, p.y, codes.y, gradient.y);
    update_code(first + 2, p.z, codes.z, gradient.z);
    update_code(first + 3, p.w, codes.w, gradient.w);
    *reinterpret_cast<float4*>(array.parameters + first) = p;
    *reinterpret_cast<ushort4*>(array.moments + first) = codes;
    if (is_touched) sums = float4{0, 0, 0, 0};
  } else {
    for (std::size_t i = first; i < array.size; ++i) {
      update(i, array.parameters[i], array.moments[i], array.sums[i]);
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
          constexpr int kInRow = int(sizeof(parameters[0]) / sizeof(float));
          const Span<float> numbers = numbers_of(parameters);
          context_.launch("adam", adam_codes_kernel<kInRow>, blocks_for(numbers.size, kThreads),
                          kThreads, numbers, codes_of(moments), numbers_of(gradient), step, rule,
                          rounding, place);
        },
        model.gaussians, model.codes, gradients, steps, number_places());
  }

  Context& context_;
};

}  // namespace

void update_by_sums(Context& context, TrainingModel& model, const AdamSteps& steps,
                    const AdamRule& rule, const MomentRounding& rounding, int sh_degree,
                    bool all_have_gradients, const std::uint32_t* halted, const BatchSums& sums,
                    const Shard& shard) {
  const StageScope scope(context, "adam");
  const auto launch = [&]<class Row>(auto kernel, const auto& array, const Buffer<Row>&,
                                     const AdamStep& step) {
    constexpr int kInRow = int(sizeof(Row) / sizeof(float));
    const int in_use = kInRow == 3 * kShRestCount ? 3 * sh_rest_count(sh_degree) : kInRow;
    context.launch("adam", kernel, blocks_for(array.size, 4 * kThreads), kThreads, array, in_use,
                   step, rule, halted);
  };
  // One array with its moments, which are floats in m and v, or codes.
  const std::uint32_t* const touched = all_have_gradients ? nullptr : sums.touched.data();
  const auto update = [&]<class Row>(const char*, const Buffer<Row>& rows, const Buffer<Row>& m,
                                     const Buffer<Row>& v, const Buffer<CodedRow<Row>>& codes,
                                     const Buffer<Row>& sum, const AdamStep& step, int place) {
    constexpr int kInRow = int(sizeof(Row) / sizeof(float));
    const Span<float> numbers = numbers_of(rows);
    if (model.moment_form == MomentForm::tiny)
      launch(update_codes_by_sums_kernel<kInRow>,
             SummedCodes{numbers.data, codes_of(codes).data, numbers_of(sum).data, numbers.size,
                         touched, rounding, place, shard},
             rows, step);
    else
      launch(update_by_sums_kernel<kInRow>,
             SummedArray{numbers.data, numbers_of(m).data, numbers_of(v).data, numbers_of(sum).data,
                         numbers.size, touched},
             rows, step);
  };
  for_each_array(update, model.gaussians, model.first_moment, model.second_moment, model.codes,
                 sums.gradients, steps, number_places());
  context.launch("adam", add_statistics_kernel, blocks_for(model.count(), kThreads), kThreads,
                 model.statistics.visits.span(), model.statistics.gradient_norm.data(),
                 sums.statistics.visits.data(), sums.statistics.gradient_norm.data(),
                 sums.touched.data(), halted);
}

std::unique_ptr<Optimizer> make_optimizer(Context& context) {
  return std::make_unique<CudaOptimizer>(context);
}

}  // namespace gs::cuda
