// SPDX-License-Identifier: Apache-2.0
// What a step adds for a photometric model: the sum of a photo's gradient after stage 5, and the
// update of all photos with stage 8. Twin of gs_train/stages/photometric.cpp.
//
// Both kernels are a single block, because there are few numbers, and because all sums then have an
// order of their own: the same bits come out each time. Sums are in double, as in the scalar twin.
#include "cuda/photo_terms/photometric.cuh"

#include "cuda/device/block_sums.cuh"
#include "gs_train/photometric/gains.h"

namespace gs::cuda {
namespace {

// Threads of a block: a multiple of kNumbers makes all numbers of a thread those of one channel.
constexpr int kNumbers = 3, kThreads = 768;  // of a photo: log gains

__global__ void __launch_bounds__(kThreads)
    add_gradient_kernel(Span<const float> of_blocks, PhotoOnDevice photo) {
  __shared__ double shared[1][kThreads];
  double sum[1] = {0};
  for (std::size_t i = threadIdx.x; i < of_blocks.size; i += kThreads)
    sum[0] += double(of_blocks[i]);
  sum_by_remainder<kNumbers>(sum, shared);
  const int i = int(threadIdx.x);
  if (i < kNumbers) photo.photo_gradient[i] += photo.weight * shared[0][i];
}

/// The numbers of all photos on the device.
struct Numbers {
  float* values;
  FloatMoments* moments;
  const float* start;
  std::uint32_t photos;
  bool is_solved;

  __device__ std::uint32_t size() const { return photos * std::uint32_t(kNumbers); }
};

/// Thread t takes the numbers t, t + kThreads, ... Clears the gradient.
__device__ void update_all(const Numbers& numbers, double* gradient, const AdamStep& step,
                           const AdamRule& rule) {
  for (std::uint32_t i = threadIdx.x; i < numbers.size(); i += kThreads) {
    double prior = 0;
    if (numbers.is_solved)
      prior = gain_prior_vjp(double(numbers.values[i]), double(numbers.start[i]),
                             kGainPriorWeight / numbers.photos, kGainPriorSpread);
    adam_update(numbers.values[i], numbers.moments[i], float(gradient[i] + prior), step, rule);
    gradient[i] = 0;
  }
}

/// Subtracts from each number of the photos its mean.
__device__ void center(const Numbers& numbers, double (&shared)[1][kThreads]) {
  double sum[1] = {0};
  for (std::uint32_t i = threadIdx.x; i < numbers.size(); i += kThreads)
    sum[0] += double(numbers.values[i]);
  sum_by_remainder<kNumbers>(sum, shared);
  const double common = shared[0][int(threadIdx.x) % kNumbers] / double(numbers.photos);
  for (std::uint32_t i = threadIdx.x; i < numbers.size(); i += kThreads)
    numbers.values[i] = float(double(numbers.values[i]) - common);
}

__global__ void __launch_bounds__(kThreads)
    update_kernel(Numbers numbers, double* gradient, AdamStep step, AdamRule rule,
                  const std::uint32_t* halted) {
  if (*halted) return;
  __shared__ double shared[1][kThreads];
  update_all(numbers, gradient, step, rule);
  __syncthreads();  // all values are new
  center(numbers, shared);
}

}  // namespace

void add_look_gradient(Context& context, Span<const float> of_blocks, const PhotoOnDevice& photo) {
  if (!photo.photo_gradient) return;
  const StageScope scope(context, "photometric");
  context.launch("photometric", add_gradient_kernel, 1, kThreads, of_blocks, photo);
}

void update_photometric(Context& context, const PhotometricState& state, Span<double> gradient,
                        const AdamStep& step, const AdamRule& rule, const std::uint32_t* halted) {
  const PhotometricShape& shape = state.shape;
  GS_CHECK(int(shape.photo_size) == kNumbers && gradient.size == shape.size());
  const StageScope scope(context, "photometric");
  const Numbers numbers{state.values.data(), state.moments.data(), state.start.data(), shape.photos,
                        state.is_solved};
  context.launch("photometric", update_kernel, 1, kThreads, numbers, gradient.data, step, rule,
                 halted);
}

}  // namespace gs::cuda
