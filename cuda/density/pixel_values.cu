// SPDX-License-Identifier: Apache-2.0
// In a score pass of density control: the values of the pixels of a photo, twin of
// gs_train/stages/pixel_values.cpp.
#include "cuda/photo_terms/photometric.cuh"
#include "cuda/stages.cuh"
#include "gs_core/image.h"
#include "gs_core/math/loss/photo_weight.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // pixels are independent: any size that fills the GPU

__device__ std::size_t thread_number() { return std::size_t(blockIdx.x) * kThreads + threadIdx.x; }

/// A render and its photo.
struct ComparedPictures {
  const float* image;  // (3, H, W)
  PhotoBytes bytes;
  int width, height;
  Vec3f exposure, background;
  bool over_background;
  float white;
  bool is_learned;  // the appearance: `look` stands in place of the exposure
  PhotoLook look;
};

__global__ void errors_kernel(ComparedPictures pictures, Span<float> values) {
  const std::size_t i = thread_number();
  if (i >= values.size) return;
  const float m = pictures.bytes.mask ? pictures.bytes.mask[i] * kPerByte : 1.0f;
  float sum = 0;
  for (int c = 0; c < 3; ++c) {
    const float e = pictures.is_learned ? pictures.look.photo_gain(c) : pictures.exposure[c];
    const PhotoWeight<float> weight =
        photo_weight(m, e, pictures.background[c], pictures.over_background);
    const float x = weight.gain * pictures.image[c * values.size + i];
    const float y = pictures.bytes.photo[3 * i + c] * kPerByte;
    sum += fabsf(x - compared_photo(x, weight.cover * y + weight.backdrop, y, pictures.white));
  }
  values[i] = sum / 3.0f;
}

__global__ void edges_kernel(const std::uint8_t* photo, int width, int height, Span<float> values) {
  const std::size_t i = thread_number();
  if (i >= values.size) return;
  const int x = int(i % std::size_t(width)), y = int(i / std::size_t(width));
  const auto gray = [&](int column, int row) {
    column = clamp_to(column, 0, width - 1);
    row = clamp_to(row, 0, height - 1);
    const std::uint8_t* const rgb = photo + 3 * (std::size_t(row) * width + std::size_t(column));
    return (rgb[0] + rgb[1] + rgb[2]) * (kPerByte / 3.0f);
  };
  float sum = -9.0f * gray(x, y);
  for (int dy = -1; dy <= 1; ++dy)
    for (int dx = -1; dx <= 1; ++dx) sum += gray(x + dx, y + dy);
  values[i] = fabsf(sum);
}

// The smallest and the largest value. The bits of floats from 0 on are ordered as the floats are.
__global__ void range_kernel(Span<const float> values, std::uint32_t* range) {
  const std::size_t i = thread_number();
  const bool exists = i < values.size;
  const std::uint32_t bits = exists ? __float_as_uint(values[i]) : 0;
  const std::uint32_t highest = warp_max(bits);
  const std::uint32_t lowest = ~warp_max(exists ? ~bits : 0u);
  if (lane_of_thread() != 0 || !exists) return;
  atomicMin(range, lowest);
  atomicMax(range + 1, highest);
}

// To the range 0 to 1 of the view; with a limit, to 1 above it and 0 elsewhere.
__global__ void stretch_kernel(Span<float> values, const std::uint32_t* range, float limit) {
  const std::size_t i = thread_number();
  if (i >= values.size) return;
  const float from = __uint_as_float(range[0]), span = __uint_as_float(range[1]) - from;
  const float scale = span > 0 ? 1 / span : 0;
  const float value = (values[i] - from) * scale;
  values[i] = limit < 0 ? value : value > limit ? 1.0f : 0.0f;
}

}  // namespace

void find_pixel_values(Context& context, const PhotoBytes& bytes, const View& view,
                       const PhotoOnDevice* photo, const PixelRule& rule, Workspace& workspace,
                       const RenderPass& pass) {
  const StageScope scope(context, "pixel values");
  const std::size_t pixels = pass.pixel_count(), blocks = blocks_for(pixels, kThreads);
  workspace.pixel_values.resize_discard(pixels);
  const Span<float> values = workspace.pixel_values.span();
  const ComparedPictures pictures{
      pass.image.data(), bytes,           pass.width,           pass.height,
      view.exposure,     pass.background, view.over_background, photo ? kPhotoWhite : view.white(),
      photo != nullptr,  PhotoLook(photo)};
  if (rule.score == GrowthScore::edge)
    context.launch("pixel values", edges_kernel, blocks, kThreads, bytes.photo, pass.width,
                   pass.height, values);
  else
    context.launch("pixel values", errors_kernel, blocks, kThreads, pictures, values);
  if (rule.score == GrowthScore::error) return;
  workspace.value_range.resize_discard(2);
  std::uint32_t* const range = workspace.value_range.data();
  check(cudaMemsetAsync(range, 0xff, sizeof(std::uint32_t), context.stream()), "pixel values");
  check(cudaMemsetAsync(range + 1, 0, sizeof(std::uint32_t), context.stream()), "pixel values");
  context.launch("pixel values", range_kernel, blocks, kThreads, values, range);
  const float limit = rule.score == GrowthScore::mask ? rule.mask_error : -1.0f;
  context.launch("pixel values", stretch_kernel, blocks, kThreads, values, range, limit);
}

}  // namespace gs::cuda
