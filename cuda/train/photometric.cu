// SPDX-License-Identifier: Apache-2.0
// What a step adds for a photometric model: for "gains" the sum of a photo's gradient after stage
// 5, and for all models the update of all photos and cameras with stage 8. Twin of
// gs_train/stages/photometric.cpp.
//
// Both kernels are a single block, because there are few numbers, and because all sums then have an
// order of their own: the same bits come out each time. Sums are in double, as in the scalar twin.
#include "cuda/train/photometric.cuh"

#include <numbers>

#include "cuda/device/block_sums.cuh"
#include "gs_train/photometric/gains.h"
#include "gs_train/photometric/lens_model.h"
#include "gs_train/photometric/ppisp.h"

namespace gs::cuda {
namespace {

constexpr int kSums = 4;  // numbers in LookSums

/// How the numbers of a photo are updated, by the model. Threads of a block: a multiple of
/// kNumbers makes all numbers of a thread the same number of different photos.
struct GainsRule {
  static constexpr int kNumbers = 3, kThreads = 768;
  /// Of the pull to solved values.
  static __device__ double spread(int) { return kGainPriorSpread; }
  /// What a log unit of brightness in the middle of the lens is worth.
  static __device__ double of_middle(int) { return 1; }
};
struct PpispRule {
  static constexpr int kNumbers = int(kPpispNumbers), kThreads = 9 * 64;
  static __device__ double spread(int number) {
    return number == 0 ? kPpispExposureSpread : kPpispLatentSpread;
  }
  static __device__ double of_middle(int number) { return number == 0 ? 1 / std::numbers::ln2 : 0; }
};

__global__ void __launch_bounds__(GainsRule::kThreads)
    add_gradient_kernel(Span<const LookSums> of_blocks, PhotoOnDevice photo) {
  __shared__ double shared[kSums][GainsRule::kThreads];
  double sums[kSums] = {0, 0, 0, 0};
  for (std::size_t i = threadIdx.x; i < of_blocks.size; i += GainsRule::kThreads) {
    const LookSums block = of_blocks[i];
    sums[0] += double(block.x), sums[1] += double(block.y);
    sums[2] += double(block.z), sums[3] += double(block.w);
  }
  sum_by_remainder<3>(sums, shared);
  const int i = int(threadIdx.x);
  if (i >= 3) return;
  photo.photo_gradient[i] += photo.weight * shared[0][i];
  if (photo.camera)  // dL/dB = -G, of all channels
    photo.camera_gradient[i] -=
        photo.weight * (shared[1 + i][0] + shared[1 + i][1] + shared[1 + i][2]);
}

/// The numbers of all photos and cameras on the device.
struct Numbers {
  float *values, *first_moment, *second_moment;
  const float* start;
  const std::uint32_t* camera_of;
  std::uint32_t photos, cameras;  // cameras: 0 without vignetting
  std::uint32_t camera_begin;     // of all cameras
  bool is_solved;

  __device__ std::array<double, 3> lens(std::uint32_t camera) const {
    const float* const b = values + (camera_begin + 3 * camera);
    return {double(b[0]), double(b[1]), double(b[2])};
  }
};

/// Updates number i by the gradients of the data and of a penalty, and clears the former.
__device__ void update_number(const Numbers& numbers, std::uint32_t i, double* of_data,
                              double of_penalty, const AdamStep& step, const AdamRule& rule) {
  adam_update(numbers.values[i], numbers.first_moment[i], numbers.second_moment[i],
              float(of_data[i] + of_penalty), step, rule);
  of_data[i] = 0;
}

/// Thread t takes the numbers t, t + kThreads, ... of the photos, and the cameras t, t + kThreads,
/// ...
template <class Rule>
__device__ void update_all(const Numbers& numbers, double* gradient, const AdamStep& step,
                           const AdamRule& rule) {
  const double spread = Rule::spread(int(threadIdx.x) % Rule::kNumbers);
  for (std::uint32_t i = threadIdx.x; i < numbers.camera_begin; i += Rule::kThreads) {
    double prior = 0;
    if (numbers.is_solved)
      prior = gain_prior_vjp(double(numbers.values[i]), double(numbers.start[i]),
                             kGainPriorWeight / numbers.photos, spread);
    update_number(numbers, i, gradient, prior, step, rule);
  }
  for (std::uint32_t camera = threadIdx.x; camera < numbers.cameras; camera += Rule::kThreads) {
    const std::array<double, 3> rim = bright_rim_vjp(numbers.lens(camera), kBrightRimWeight);
    const std::uint32_t first = numbers.camera_begin + 3 * camera;
    for (std::uint32_t i = 0; i < 3; ++i)
      update_number(numbers, first + i, gradient, rim[i], step, rule);
  }
}

/// Subtracts from each number of the photos its mean above the middle of the lenses.
template <class Rule>
__device__ void center(const Numbers& numbers, double (&shared)[1][Rule::kThreads]) {
  const int number = int(threadIdx.x) % Rule::kNumbers;
  const double of_middle = numbers.cameras ? Rule::of_middle(number) : 0;
  double sum[1] = {0};
  for (std::uint32_t i = threadIdx.x; i < numbers.camera_begin; i += Rule::kThreads) {
    sum[0] += double(numbers.values[i]);
    if (of_middle != 0)
      sum[0] -=
          of_middle * log_vignetting(numbers.lens(numbers.camera_of[i / Rule::kNumbers]), 0.0);
  }
  sum_by_remainder<Rule::kNumbers>(sum, shared);
  const double common = shared[0][number] / double(numbers.photos);
  for (std::uint32_t i = threadIdx.x; i < numbers.camera_begin; i += Rule::kThreads)
    numbers.values[i] = float(double(numbers.values[i]) - common);
}

template <class Rule>
__global__ void __launch_bounds__(Rule::kThreads)
    update_kernel(Numbers numbers, double* gradient, AdamStep step, AdamRule rule,
                  const std::uint32_t* halted) {
  if (*halted) return;
  __shared__ double shared[1][Rule::kThreads];
  update_all<Rule>(numbers, gradient, step, rule);
  __syncthreads();  // all values are new
  center<Rule>(numbers, shared);
}

template <class Rule>
void update(Context& context, const PhotometricState& state, Span<const std::uint32_t> camera_of,
            Span<double> gradient, const AdamStep& step, const AdamRule& rule,
            const std::uint32_t* halted) {
  const PhotometricShape& shape = state.shape;
  GS_CHECK(int(shape.photo_size) == Rule::kNumbers);
  GS_CHECK(shape.camera_size == 3 || shape.camera_size == 0);
  GS_CHECK(gradient.size == shape.size() && camera_of.size == shape.photos);
  const StageScope scope(context, "photometric");
  const Numbers numbers{state.values.data(),
                        state.first_moment.data(),
                        state.second_moment.data(),
                        state.start.data(),
                        camera_of.data,
                        shape.photos,
                        shape.camera_size ? shape.cameras : 0,
                        std::uint32_t(shape.camera_begin(0)),
                        state.is_solved};
  context.launch("photometric", update_kernel<Rule>, 1, Rule::kThreads, numbers, gradient.data,
                 step, rule, halted);
}

}  // namespace

void add_look_gradient(Context& context, Span<const LookSums> of_blocks,
                       const PhotoOnDevice& photo) {
  if (!photo.photo_gradient) return;
  const StageScope scope(context, "photometric");
  context.launch("photometric", add_gradient_kernel, 1, GainsRule::kThreads, of_blocks, photo);
}

void update_photometric(Context& context, DeviceLook look, const PhotometricState& state,
                        Span<const std::uint32_t> camera_of, Span<double> gradient,
                        const AdamStep& step, const AdamRule& rule, const std::uint32_t* halted) {
  switch (look) {
    case DeviceLook::gains:
      return update<GainsRule>(context, state, camera_of, gradient, step, rule, halted);
    case DeviceLook::ppisp:
      return update<PpispRule>(context, state, camera_of, gradient, step, rule, halted);
  }
}

}  // namespace gs::cuda
