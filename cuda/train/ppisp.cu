// SPDX-License-Identifier: Apache-2.0
// The passes around stage 5 of the photometric model "ppisp", whose photos mix channels: a picture
// as its photo shows it, and the gradient back. A thread takes some pixels, a block adds up its
// threads' sums, and a single block those of all blocks. Each sum has an order of its own, so that
// the same bits come out each time.
#include "cuda/train/ppisp.cuh"

#include <numbers>

#include "cuda/device/block_sums.cuh"
#include "cuda/device/warp.cuh"
#include "gs_core/image.h"
#include "gs_train/photometric/ppisp.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;                               // of the kernels over pixels
constexpr int kPixelsOfThread = 8;                          // shares the matrix of the photo
constexpr int kPixelsOfBlock = kThreads * kPixelsOfThread;  // does not depend on the GPU
constexpr int kWarps = kThreads / kWarp;
constexpr int kSums = 16;  // exposure 1, dL/dM 9, dL/dk 3, lens 3
constexpr int kAddingThreads = 32 * kSums;

/// A rendered picture.
struct Rendered {
  const float* image;  // (3, H, W)
  int width;
  std::size_t pixels;

  explicit Rendered(const RenderPass& pass)
      : image(pass.image.data()), width(pass.width), pixels(pass.pixel_count()) {}
  __device__ Vec3f color(std::size_t pixel) const { return color_of(image, pixel); }
  __device__ Vec3f color_of(const float* planes, std::size_t pixel) const {
    return {planes[pixel], planes[pixels + pixel], planes[2 * pixels + pixel]};
  }
  __device__ void put(float* planes, std::size_t pixel, const Vec3f& color) const {
    for (int c = 0; c < 3; ++c) planes[std::size_t(c) * pixels + pixel] = color[c];
  }
  __device__ float rho(const PpispColors& colors, std::size_t pixel) const {
    return colors.rho(int(pixel % std::size_t(width)), int(pixel / std::size_t(width)));
  }
};

/// Calls f(pixel) for each pixel of this thread.
template <class F>
__device__ void for_each_pixel(const Rendered& rendered, F&& f) {
  const std::size_t first = std::size_t(blockIdx.x) * kPixelsOfBlock + threadIdx.x;
  for (int k = 0; k < kPixelsOfThread; ++k) {
    const std::size_t pixel = first + std::size_t(k) * kThreads;
    if (pixel < rendered.pixels) f(pixel);
  }
}

/// `behind` is null where photos are not over the background.
__global__ void __launch_bounds__(kThreads)
    show_kernel(Rendered rendered, PpispLook look, Vec3f background, float* shown, float* behind) {
  const PpispColors colors(look);
  for_each_pixel(rendered, [&](std::size_t pixel) {
    const float rho = rendered.rho(colors, pixel);
    rendered.put(shown, pixel, colors.shown(rendered.color(pixel), rho));
    if (behind) rendered.put(behind, pixel, colors.shown(background, rho));
  });
}

/// What the pixels of a thread add up to.
struct PpispSums {
  float log_gain = 0;  // dL by the logarithm of the gain
  RecoloredSums<float> colors{};
  float lens[3] = {0, 0, 0};
};

/// Writes the sums over the block's threads. All of them take part.
__device__ void store_sums(const PpispSums& sums, float* of_block) {
  __shared__ float of_warps[kWarps][kSums];
  const RecoloredSums<float>& of_colors = sums.colors;
  const Vec3f rows[] = {of_colors.M.row0, of_colors.M.row1, of_colors.M.row2, of_colors.k};
  float all[kSums] = {sums.log_gain};
  for (int i = 0; i < 12; ++i) all[1 + i] = rows[i / 3][i % 3];
  for (int i = 0; i < 3; ++i) all[13 + i] = sums.lens[i];
  for (int k = 0; k < kSums; ++k) {
    const float of_warp = warp_sum(all[k]);
    if (lane_of_thread() == 0) of_warps[threadIdx.x / kWarp][k] = of_warp;
  }
  __syncthreads();
  if (int(threadIdx.x) >= kSums) return;
  float sum = 0;
  for (int warp = 0; warp < kWarps; ++warp) sum += of_warps[warp][threadIdx.x];
  of_block[threadIdx.x] = sum;
}

/// `gradient` holds dL/d(shown), then dL/d(image). `cover` may be null.
__global__ void __launch_bounds__(kThreads)
    pull_back_kernel(Rendered rendered, PpispLook look, const std::uint8_t* cover, float* gradient,
                     float* of_blocks) {
  const PpispColors colors(look);
  PpispSums sums;
  for_each_pixel(rendered, [&](std::size_t pixel) {
    const float rho = rendered.rho(colors, pixel), gain = colors.gain(rho);
    const float share = cover ? float(cover[pixel]) * kPerByte : 1.0f;
    const Vec3f color = rendered.color(pixel), dL_dshown = rendered.color_of(gradient, pixel);
    const float dL_dlog = share * inner(dL_dshown, gain * recolored(colors.matrix, color));
    rendered.put(gradient, pixel,
                 recolored_vjp(colors.matrix, color, gain * dL_dshown, share, sums.colors));
    sums.log_gain += dL_dlog;
    if (!colors.has_lens) return;
    const std::array<float, 3> dL_db = log_vignetting_vjp(rho, -dL_dlog);
    for (std::size_t i = 0; i < 3; ++i) sums.lens[i] += dL_db[i];
  });
  store_sums(sums, of_blocks + kSums * std::size_t(blockIdx.x));
}

/// The matrix of a photo, in double: color_matrix_vjp() is linear in its sums, and they are in
/// double, as in the scalar twin.
__device__ ColorMatrix<double> in_double(const ColorMatrix<float>& matrix) {
  return {{Vec3d(matrix.M.row0), Vec3d(matrix.M.row1), Vec3d(matrix.M.row2)},
          Vec3d(matrix.k),
          Vec3d(matrix.unlimited_k)};
}

/// Adds the blocks' sums and pulls them back to the photo's numbers.
__global__ void __launch_bounds__(kAddingThreads)
    add_gradient_kernel(Span<const float> of_blocks, PpispLook look, PhotoOnDevice photo) {
  __shared__ double shared[1][kAddingThreads];
  double sum[1] = {0};
  for (std::size_t i = threadIdx.x; i < of_blocks.size; i += kAddingThreads)
    sum[0] += double(of_blocks[i]);
  sum_by_remainder<kSums>(sum, shared);
  if (threadIdx.x != 0) return;
  const double* const sums = shared[0];
  RecoloredSums<double> of_colors;
  of_colors.M = {
      {sums[1], sums[2], sums[3]}, {sums[4], sums[5], sums[6]}, {sums[7], sums[8], sums[9]}};
  of_colors.k = {sums[10], sums[11], sums[12]};
  const ColorLatents<double> dL_dlatents =
      color_matrix_vjp(in_double(PpispColors(look).matrix), of_colors);
  photo.photo_gradient[0] += photo.weight * std::numbers::ln2 * sums[0];
  for (std::size_t i = 0; i < kPpispLatents; ++i)
    photo.photo_gradient[1 + i] += photo.weight * dL_dlatents[i];
  if (!photo.camera) return;
  for (std::size_t i = 0; i < 3; ++i) photo.camera_gradient[i] += photo.weight * sums[13 + i];
}

}  // namespace

void RecoloredPicture::show(const RenderPass& pass, const PhotoOnDevice& photo,
                            bool over_background) {
  const std::size_t pixels = pass.pixel_count();
  shown_.resize_discard(3 * pixels);
  if (over_background) behind_.resize_discard(3 * pixels);
  const StageScope scope(context_, "photometric");
  context_.launch("photometric", show_kernel, blocks_for(pixels, kPixelsOfBlock), kThreads,
                  Rendered(pass), PpispLook(photo), pass.background, shown_.data(),
                  over_background ? behind_.data() : nullptr);
}

void RecoloredPicture::pull_back(const RenderPass& pass, const PhotoOnDevice& photo,
                                 const std::uint8_t* cover, float* dL_dshown) {
  const std::size_t blocks = blocks_for(pass.pixel_count(), kPixelsOfBlock);
  sums_.resize_discard(kSums * blocks);
  const StageScope scope(context_, "photometric");
  const PpispLook look(photo);
  context_.launch("photometric", pull_back_kernel, blocks, kThreads, Rendered(pass), look, cover,
                  dL_dshown, sums_.data());
  if (photo.photo_gradient)
    context_.launch("photometric", add_gradient_kernel, 1, kAddingThreads,
                    Span<const float>(sums_.span()), look, photo);
}

}  // namespace gs::cuda
