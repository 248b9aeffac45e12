// SPDX-License-Identifier: Apache-2.0
// What a step adds for the photometric model "gains": the sum of a photo's gradient after stage 5,
// and the update of all photos and cameras with stage 8. Twin of gs_train/stages/photometric.cpp.
//
// Both kernels are a single block, because there are few numbers, and because all sums then have an
// order of their own: the same bits come out each time. Sums are in double, as in the scalar twin.
#include "cuda/train/photometric.cuh"

#include "gs_train/photometric/gains.h"
#include "gs_train/photometric/lens_model.h"

namespace gs::cuda {
namespace {

// Threads of a block. A multiple of 3 makes a thread's slots all of one channel, and the number of
// threads of a channel is a power of two, which the sum over them halves.
constexpr int kThreads = 768;
constexpr int kSums = 4;  // numbers in LookSums

/// Adds up the threads' sums, by the remainder of the thread's number by 3: thread r < 3 has the
/// sum of all threads r, r + 3, r + 6, ... afterwards. All threads of the block take part.
template <int kCount>
__device__ void sum_by_remainder(double (&sums)[kCount], double (&shared)[kCount][kThreads]) {
  for (int k = 0; k < kCount; ++k) shared[k][threadIdx.x] = sums[k];
  for (int half = kThreads / 2; half >= 3; half /= 2) {
    __syncthreads();
    if (int(threadIdx.x) < half)
      for (int k = 0; k < kCount; ++k) shared[k][threadIdx.x] += shared[k][int(threadIdx.x) + half];
  }
  __syncthreads();
  for (int k = 0; k < kCount; ++k) sums[k] = shared[k][threadIdx.x];
}

__global__ void __launch_bounds__(kThreads)
    add_gradient_kernel(Span<const LookSums> of_blocks, PhotoOnDevice photo) {
  __shared__ double shared[kSums][kThreads];
  double sums[kSums] = {0, 0, 0, 0};
  for (std::size_t i = threadIdx.x; i < of_blocks.size; i += kThreads) {
    const LookSums block = of_blocks[i];
    sums[0] += double(block.x), sums[1] += double(block.y);
    sums[2] += double(block.z), sums[3] += double(block.w);
  }
  sum_by_remainder(sums, shared);
  const int i = int(threadIdx.x);
  if (i >= 3) return;
  photo.photo_gradient[i] += photo.weight * shared[0][i];
  if (photo.camera)  // dL/dB = -G, of all channels
    photo.camera_gradient[i] -=
        photo.weight * (shared[1 + i][0] + shared[1 + i][1] + shared[1 + i][2]);
}

/// The numbers of all photos and cameras on the device.
struct Gains {
  float *values, *first_moment, *second_moment;
  const float* start;
  const std::uint32_t* camera_of;
  std::uint32_t photos, cameras;  // cameras: 0 without vignetting
  bool is_solved;

  __device__ std::array<double, 3> lens(std::uint32_t camera) const {
    const float* const b = values + 3 * (photos + camera);
    return {double(b[0]), double(b[1]), double(b[2])};
  }
};

/// Updates number i by the gradients of the data and of a penalty, and clears the former.
__device__ void update_number(const Gains& gains, std::uint32_t i, double* of_data,
                              double of_penalty, const AdamStep& step, const AdamRule& rule) {
  adam_update(gains.values[i], gains.first_moment[i], gains.second_moment[i],
              float(of_data[i] + of_penalty), step, rule);
  of_data[i] = 0;
}

/// Thread t takes the numbers t, t + kThreads, ... of the photos, and the cameras t, t + kThreads,
/// ...
__device__ void update_all(const Gains& gains, double* gradient, const AdamStep& step,
                           const AdamRule& rule) {
  for (std::uint32_t i = threadIdx.x; i < 3 * gains.photos; i += kThreads) {
    double prior = 0;
    if (gains.is_solved)
      prior = gain_prior_vjp(double(gains.values[i]), double(gains.start[i]),
                             kGainPriorWeight / gains.photos, kGainPriorSpread);
    update_number(gains, i, gradient, prior, step, rule);
  }
  for (std::uint32_t camera = threadIdx.x; camera < gains.cameras; camera += kThreads) {
    const std::array<double, 3> rim = bright_rim_vjp(gains.lens(camera), kBrightRimWeight);
    const std::uint32_t first = 3 * (gains.photos + camera);
    for (std::uint32_t i = 0; i < 3; ++i)
      update_number(gains, first + i, gradient, rim[i], step, rule);
  }
}

/// Subtracts from each channel's log gains their mean above the middle of the lenses. kThreads is a
/// multiple of 3, so that a thread has numbers of one channel.
__device__ void center(const Gains& gains, double (&shared)[1][kThreads]) {
  double sum[1] = {0};
  for (std::uint32_t i = threadIdx.x; i < 3 * gains.photos; i += kThreads) {
    sum[0] += double(gains.values[i]);
    if (gains.cameras) sum[0] -= log_vignetting(gains.lens(gains.camera_of[i / 3]), 0.0);
  }
  sum_by_remainder(sum, shared);
  const double common = shared[0][threadIdx.x % 3] / double(gains.photos);
  for (std::uint32_t i = threadIdx.x; i < 3 * gains.photos; i += kThreads)
    gains.values[i] = float(double(gains.values[i]) - common);
}

__global__ void __launch_bounds__(kThreads)
    update_kernel(Gains gains, double* gradient, AdamStep step, AdamRule rule,
                  const std::uint32_t* halted) {
  if (*halted) return;
  __shared__ double shared[1][kThreads];
  update_all(gains, gradient, step, rule);
  __syncthreads();  // all values are new
  center(gains, shared);
}

}  // namespace

void add_look_gradient(Context& context, Span<const LookSums> of_blocks,
                       const PhotoOnDevice& photo) {
  if (!photo.photo_gradient) return;
  const StageScope scope(context, "photometric");
  context.launch("photometric", add_gradient_kernel, 1, kThreads, of_blocks, photo);
}

void update_gains(Context& context, const PhotometricState& state,
                  Span<const std::uint32_t> camera_of, Span<double> gradient, const AdamStep& step,
                  const AdamRule& rule, const std::uint32_t* halted) {
  const PhotometricShape& shape = state.shape;
  GS_CHECK(shape.photo_size == 3 && (shape.camera_size == 3 || shape.camera_size == 0));
  GS_CHECK(gradient.size == shape.size() && camera_of.size == shape.photos);
  const StageScope scope(context, "photometric");
  const Gains gains{state.values.data(),
                    state.first_moment.data(),
                    state.second_moment.data(),
                    state.start.data(),
                    camera_of.data,
                    shape.photos,
                    shape.camera_size ? shape.cameras : 0,
                    state.is_solved};
  context.launch("photometric", update_kernel, 1, kThreads, gains, gradient.data, step, rule,
                 halted);
}

}  // namespace gs::cuda
