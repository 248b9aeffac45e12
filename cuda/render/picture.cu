// SPDX-License-Identifier: Apache-2.0
// A picture as 8 bits, for films and the viewer.
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;
constexpr std::size_t kPixelsOfThread = 4;  // three words

// As to_image8 rounds. NaN becomes 0.
__device__ std::uint32_t byte_of(float value) {
  return value > 0 ? std::uint32_t(fminf(value, 1.0f) * 255.0f + 0.5f) : 0u;
}

// planes   (3, pixels)
// words    bytes (pixels, 3), four to a word, filled up with zeros
__global__ void pack_picture_kernel(const float* planes, std::size_t pixels, std::uint32_t* words) {
  const std::size_t thread = blockIdx.x * std::size_t(kThreads) + threadIdx.x;
  const std::size_t first = thread * kPixelsOfThread;
  if (first >= pixels) return;
  std::uint32_t packed[3] = {};
#pragma unroll
  for (int k = 0; k < int(kPixelsOfThread); ++k)
#pragma unroll
    for (int c = 0; c < 3; ++c) {
      const int byte = 3 * k + c;
      const float value = first + k < pixels ? planes[c * pixels + first + k] : 0.0f;
      packed[byte / 4] |= byte_of(value) << 8 * (byte % 4);
    }
  for (int k = 0; k < 3; ++k) words[3 * thread + k] = packed[k];
}

}  // namespace

void pack_picture(Context& context, const RenderPass& pass, Buffer<std::uint32_t>& words) {
  const std::size_t pixels = pass.pixel_count(),
                    threads = (pixels + kPixelsOfThread - 1) / kPixelsOfThread;
  words.resize_discard(3 * threads);
  context.launch("picture of 8 bits", pack_picture_kernel, blocks_for(threads, kThreads), kThreads,
                 pass.image.data(), pixels, words.data());
}

}  // namespace gs::cuda
