// SPDX-License-Identifier: Apache-2.0
// Stage 5: the photometric loss and its gradient by the picture. Twin of gs_train/stages/ssim.cpp.
//
//   L = (1 - lambda) mean|X - Y| + lambda (1 - mean SSIM(X, Y))   over 3 H W values
//                                                                      Kerbl et al. 2023, Eq. 7
//
// There are two kernels. similarity_kernel computes the moments of both pictures and, from them,
// the sums and d_x, d_xx, d_xy. image_gradient_kernel computes the windowed means of those and adds
// them up (see the scalar twin). In both, a block owns kBlockRows x kBlockColumns pixels of one
// channel, and works in two passes:
//   down    Each thread walks down one column, halo rows included. It keeps the unfinished sums of
//           the window in registers and writes finished ones to shared memory.
//   across  Each warp takes whole rows of those. A thread computes four neighboring means from
//           sixteen values.
// All arithmetic is fp32. SSIM needs xx and yy only as their sum. With p = X + Y and q = X - Y the
// moments are those of p, q, pp, qq: four windows instead of five, and two multiplications a pixel.
//
// Views with a mask or an exposure use kernels of their own, in which photo_weight.h computes X and
// Y from the two pictures, so that other views are not slowed down. So do views with a learned
// appearance (photometric.cuh): their kernels also add up the gradient of the photo's numbers. And so
// do pictures that callers of the operator compare with others of theirs, of any number of planes.
#include <cstdint>

#include "cuda/device/block_sums.cuh"
#include "cuda/photo_terms/photometric.cuh"
#include "cuda/stages.cuh"
#include "gs_core/image.h"
#include "gs_core/math/loss/photo_weight.h"
#include "gs_core/math/loss/ssim.h"

namespace gs::cuda {
namespace {

// Columns that a block reads. Fewer would read more halo; more would leave the GPU idle on small
// pictures.
constexpr int kThreads = 128;
constexpr int kWarps = kThreads / kWarp;
constexpr int kGroup = 4;  // neighboring means that a thread computes: 16 bytes
constexpr int kBlockColumns = (kThreads - 2 * kSsimRadius) / kGroup * kGroup;
constexpr int kBlockRows = 16;  // sets shared memory and code size, not the number of open sums

/// What X is, besides the rendered picture. Each has kernels of its own.
enum class Shown {
  plain,     // the picture
  weighted,  // the picture under a mask or an exposure
  gained,    // under a mask, perhaps, and the learned gains of the photo
  given,     // the picture, beside another picture in place of a photo
};

/// Both pictures, and how blocks cover them.
struct Pictures {
  const float* image;         // (3, H, W)
  const std::uint8_t* photo;  // (H, W, 3)
  int width, height;          // pixels
  int blocks_x;               // in a row of blocks
  // Of weighted views only
  const std::uint8_t* mask;  // (H, W); null: every pixel trains
  Vec3f exposure, background;
  bool over_background;
  float white;
  PhotoLook look;  // of views with a learned appearance, in place of the exposure
  // Of given pictures only; both are (planes, H, W)
  const float* reference = nullptr;
  int planes = 3, margin = 0;  // SSIM does not count in so many pixels at each border
};

/// d_x, d_xx, d_xy: (3 channels, H, row_floats / 96, 3 maps, 32 columns), so that one address leads
/// to all three.
struct Derivatives {
  float* data;
  std::int64_t row_floats;

  /// Where d_x of a pixel lies; d_xx follows kColumns floats later, then d_xy. Reads of neighboring
  /// columns are contiguous, and four columns from a multiple of four are 16 bytes in a row.
  static constexpr int kColumns = kWarp;
  __device__ float* at(int row, int x) const {
    return data + (std::int64_t(row) * row_floats + (x / kColumns * 3 * kColumns + x % kColumns));
  }
};

/// The pixels of one block. The channels of an area come one after another: they share the photo's
/// bytes.
struct Area {
  int channel, x0, y0;
};
template <Shown kShown>
__device__ inline Area area_of_block(const Pictures& pictures) {
  const unsigned planes = kShown == Shown::given ? pictures.planes : 3;
  const unsigned area = blockIdx.x / planes, row = area / unsigned(pictures.blocks_x);
  return {int(blockIdx.x % planes), int(area - row * pictures.blocks_x) * kBlockColumns,
          int(row) * kBlockRows};
}

/// Means down the columns: [row][map][column], column 0 lies kSsimRadius left of the area.
template <int kMaps>
using ColumnMeans = float[kBlockRows][kMaps][kThreads];

/// The window's weight at an offset; a constant once loops are unrolled.
__device__ constexpr float weight(int offset) {
  constexpr float half[] = {kSsimWindow[0], kSsimWindow[1], kSsimWindow[2],
                            kSsimWindow[3], kSsimWindow[4], kSsimWindow[5]};
  static_assert(kSsimRadius == 5);
  return half[offset < 0 ? -offset : offset];
}

/// The value in 0..1 of a photo's byte, rounded as in the scalar twin: equal pictures differ by
/// exactly 0.
__device__ inline float photo_value(std::uint8_t byte) { return __fmul_rn(float(byte), kPerByte); }

/// How a learned appearance shows one channel.
struct ShownChannel {
  float gain = 1, background = 0;
};
template <Shown kShown>
__device__ inline ShownChannel shown_channel(const Pictures& pictures, int channel) {
  ShownChannel shown;
  if constexpr (kShown == Shown::gained) {
    shown.gain = pictures.look.photo_gain(channel);
    shown.background = pictures.background[channel];
  }
  return shown;
}

/// X' and what it is compared with, at one value, and dX'/dX.
struct ComparedValue {
  float X, Y, gain;
  float taught;  // X' as far as the photo covers it: what a learned appearance is taught by
};

/// X and Y as they are compared. Products and sum are rounded one by one (no fused operations),
/// since both kernels must compute the same X' - Y'.
template <bool kIsWeighted>
__device__ inline ComparedValue compared(const Pictures& pictures, int channel, float X, float Y,
                                         const std::uint8_t* mask) {
  if constexpr (!kIsWeighted) return {X, Y, 1.0f, X};
  const PhotoWeight<float> weight =
      photo_weight(mask ? photo_value(__ldg(mask)) : 1.0f, pictures.exposure[channel],
                   pictures.background[channel], pictures.over_background);
  const float x_weighted = __fmul_rn(weight.gain, X);
  const float y_weighted = __fadd_rn(__fmul_rn(weight.cover, Y), weight.backdrop);
  return {x_weighted, compared_photo(x_weighted, y_weighted, Y, pictures.white), weight.gain,
          x_weighted};
}

/// The pixel under the gain of the photo.
__device__ inline ComparedValue compared_gained(const Pictures& pictures, const ShownChannel& shown,
                                                float X, float Y, const std::uint8_t* mask) {
  const PhotoWeight<float> weight = photo_weight(mask ? photo_value(__ldg(mask)) : 1.0f, shown.gain,
                                                 shown.background, pictures.over_background);
  const float x_weighted = __fmul_rn(weight.gain, X);
  const float y_weighted = __fadd_rn(__fmul_rn(weight.cover, Y), weight.backdrop);
  // The background, which the photo shows as well, teaches nothing.
  return {x_weighted, compared_photo(x_weighted, y_weighted, Y, pictures.white), weight.gain,
          weight.cover * (shown.gain * X)};
}

/// The pass down, of one thread: read(i, values) gives the maps at row i of the area with its halo.
/// At most eleven rows' sums are unfinished at a time.
template <int kMaps, class Read>
__device__ void means_down(Read&& read, ColumnMeans<kMaps>& means) {
  float sums[kBlockRows][kMaps];
#pragma unroll
  for (int i = 0; i < kBlockRows + 2 * kSsimRadius; ++i) {
    float values[kMaps];
    read(i, values);
#pragma unroll
    for (int row = 0; row < kBlockRows; ++row) {
      const int offset = i - kSsimRadius - row;
      if (offset < -kSsimRadius || offset > kSsimRadius) continue;
#pragma unroll
      for (int map = 0; map < kMaps; ++map) {
        float& sum = sums[row][map];
        sum = offset == -kSsimRadius ? weight(offset) * values[map]
                                     : fmaf(weight(offset), values[map], sum);
        if (offset == kSsimRadius) means[row][map][threadIdx.x] = sum;
      }
    }
  }
}

/// The pass across, of one thread: means[j] of the window around column[kSsimRadius + j]. `column`
/// is aligned to 16 bytes.
__device__ inline void means_across(const float* column, float (&means)[kGroup]) {
  float values[16];
#pragma unroll
  for (int i = 0; i < 4; ++i) {
    const float4 four = reinterpret_cast<const float4*>(column)[i];
    values[4 * i] = four.x, values[4 * i + 1] = four.y;
    values[4 * i + 2] = four.z, values[4 * i + 3] = four.w;
  }
#pragma unroll
  for (int j = 0; j < kGroup; ++j) {
    means[j] = weight(-kSsimRadius) * values[j];
#pragma unroll
    for (int i = 1; i <= 2 * kSsimRadius; ++i)
      means[j] = fmaf(weight(i - kSsimRadius), values[j + i], means[j]);
  }
}

__device__ inline void store_four(float* to, const float (&values)[kGroup]) {
  *reinterpret_cast<float4*>(to) = {values[0], values[1], values[2], values[3]};
}

/// One column's means of p, q, pp, qq. Returns the thread's share of the sum of |X - Y|.
template <Shown kShown>
__device__ inline float column_moments(const Pictures& pictures, const Area& area,
                                       ColumnMeans<4>& means) {
  const int x = area.x0 - kSsimRadius + int(threadIdx.x), top = area.y0 - kSsimRadius;
  const bool is_inside = x >= 0 && x < pictures.width;
  const std::int64_t width = pictures.width;
  const std::int64_t first = top * width + x;
  const float* image = pictures.image + (area.channel * width * pictures.height + first);
  const float* reference = pictures.reference + (area.channel * width * pictures.height + first);
  const std::uint8_t* photo = pictures.photo + (3 * first + area.channel);
  const std::uint8_t* mask = pictures.mask ? pictures.mask + first : nullptr;
  const ShownChannel shown = shown_channel<kShown>(pictures, area.channel);
  float l1_sum = 0;
  const auto read = [&](int i, float(&values)[4]) {
    float X = 0, Y = 0;  // outside
    if (is_inside && unsigned(top + i) < unsigned(pictures.height)) {
      ComparedValue value;
      if constexpr (kShown == Shown::given)
        value = {__ldg(image), __ldg(reference)};
      else if constexpr (kShown == Shown::gained)
        value = compared_gained(pictures, shown, __ldg(image), photo_value(__ldg(photo)), mask);
      else
        value = compared<kShown != Shown::plain>(pictures, area.channel, __ldg(image),
                                                 photo_value(__ldg(photo)), mask);
      X = value.X, Y = value.Y;
    }
    image += width, photo += 3 * width, reference += width;
    if (kShown != Shown::plain && mask) mask += width;
    const float p = X + Y, q = X - Y;
    values[0] = p, values[1] = q, values[2] = p * p, values[3] = q * q;
    if (i >= kSsimRadius && i < kSsimRadius + kBlockRows) l1_sum += fabsf(q);
  };
  means_down<4>(read, means);
  const int column = int(threadIdx.x) - kSsimRadius;
  return column >= 0 && column < kBlockColumns ? l1_sum : 0.0f;
}

/// The moments at one pixel from those of p and q; their xx is that of xx + yy.
__device__ inline WindowMeans<float> moments_of(float p, float q, float pp, float qq) {
  return {0.5f * (p + q), 0.5f * (p - q), 0.5f * (pp + qq), 0.0f, 0.25f * (pp - qq)};
}

/// Four neighboring pixels of one row: writes their derivatives, returns the sum of their SSIM.
template <Shown kShown>
__device__ inline float similarity_of_four(const Pictures& pictures, const Area& area, int y, int x,
                                           float dL_dssim, const float (&moments)[4][kGroup],
                                           const Derivatives& derivatives) {
  float d[3][kGroup], ssim_sum = 0;
  const int margin = kShown == Shown::given ? pictures.margin : 0;
  const bool has_row = y >= margin && y < pictures.height - margin;
#pragma unroll
  for (int j = 0; j < kGroup; ++j) {
    const WindowMeans<float> local =
        moments_of(moments[0][j], moments[1][j], moments[2][j], moments[3][j]);
    const bool counts =
        kShown != Shown::given || (has_row && x + j >= margin && x + j < pictures.width - margin);
    const SsimGradient<float> gradient = ssim_index_vjp(local, counts ? dL_dssim : 0.0f);
    d[0][j] = gradient.x, d[1][j] = gradient.xx, d[2][j] = gradient.xy;
    const float ssim = ssim_index(local);
    ssim_sum += counts && x + j < pictures.width ? ssim : 0.0f;
  }
#pragma unroll
  for (int map = 0; map < 3; ++map)
    store_four(derivatives.at(area.channel * pictures.height + y, x) + map * Derivatives::kColumns,
               d[map]);
  return ssim_sum;
}

/// Moments of both pictures, then SSIM and its derivatives. `sums` receives sum |X - Y| and sum
/// SSIM of each warp. The host adds them up when the loss is read, always in the same order.
template <Shown kShown>
__global__ void __launch_bounds__(kThreads, 5)
    similarity_kernel(Pictures pictures, float dL_dssim, Derivatives derivatives, float2* sums) {
  alignas(16) __shared__ ColumnMeans<4> means;
  const Area area = area_of_block<kShown>(pictures);
  const float l1_sum = column_moments<kShown>(pictures, area, means);
  __syncthreads();

  const int warp = int(threadIdx.x) / kWarp, column = kGroup * lane_of_thread();
  float ssim_sum = 0;
#pragma unroll 1
  for (int row = warp; row < kBlockRows; row += kWarps) {
    if (area.y0 + row >= pictures.height || column >= kBlockColumns) break;
    float moments[4][kGroup];
#pragma unroll
    for (int map = 0; map < 4; ++map) means_across(&means[row][map][column], moments[map]);
    ssim_sum += similarity_of_four<kShown>(pictures, area, area.y0 + row, area.x0 + column,
                                           dL_dssim, moments, derivatives);
  }
  const float2 sum{warp_sum(l1_sum), warp_sum(ssim_sum)};
  if (lane_of_thread() == 0) sums[std::size_t(blockIdx.x) * kWarps + warp] = sum;
}

/// One column's means of d_x, d_xx, d_xy.
__device__ inline void column_derivatives(const Pictures& pictures, const Area& area,
                                          const Derivatives& derivatives, ColumnMeans<3>& means) {
  const int x = area.x0 - kSsimRadius + int(threadIdx.x), top = area.y0 - kSsimRadius;
  const bool is_inside = x >= 0 && x < pictures.width;
  const float* at = derivatives.at(area.channel * pictures.height + top, x);
  const auto read = [&](int i, float(&values)[3]) {
    const bool is_pixel = is_inside && unsigned(top + i) < unsigned(pictures.height);
#pragma unroll
    for (int map = 0; map < 3; ++map)
      values[map] = is_pixel ? at[map * Derivatives::kColumns] : 0.0f;
    at += derivatives.row_floats;
  };
  means_down<3>(read, means);
}

/// The pass across for one row, by the warp that has the row. The means across replace the means
/// down in shared memory, so that a lane can continue with columns of other lanes. Surplus lanes
/// repeat the last group.
__device__ inline void replace_by_means_across(float (&row)[3][kThreads]) {
  const int column = min(kGroup * lane_of_thread(), kBlockColumns - kGroup);
  float across[3][kGroup];
#pragma unroll
  for (int map = 0; map < 3; ++map) means_across(&row[map][column], across[map]);
  __syncwarp();
#pragma unroll
  for (int map = 0; map < 3; ++map) store_four(&row[map][column], across[map]);
  __syncwarp();
}

/// The first pixel of a row of an area.
struct RowPlace {
  int channel;
  std::int64_t pixel, value;  // of its first pixel; of that pixel's value in (3, H, W)
};

/// Writes the sum over the block's threads. All of them take part.
__device__ inline void store_look_sum(float sum, float* of_block) {
  __shared__ float of_warps[kWarps];
  sum = warp_sum(sum);
  if (lane_of_thread() == 0) of_warps[threadIdx.x / kWarp] = sum;
  __syncthreads();
  if (threadIdx.x != 0) return;
  for (int warp = 1; warp < kWarps; ++warp) sum += of_warps[warp];
  *of_block = sum;
}

/// One row of the gradient, by a warp: lane l computes columns l, l + 32, ... of `columns`, so that
/// the warp reads and writes consecutive memory.
///
///   dL/dX = l1 sign(X - Y) + G * d_x + 2 X (G * d_xx) + Y (G * d_xy)
///
/// Adds the thread's share of the gradient by the photo's log gain to `look_sum`.
template <Shown kShown>
__device__ inline void gradient_of_row(const Pictures& pictures, const ShownChannel& shown,
                                       const RowPlace& place, int columns, float l1,
                                       float (&means)[3][kThreads], float* dL_dimage,
                                       float& look_sum) {
  constexpr int kTurns = (kBlockColumns + kWarp - 1) / kWarp;
  const float* image = pictures.image + place.value;
  const std::uint8_t* photo = pictures.photo + (3 * place.pixel + place.channel);
  ComparedValue values[kTurns];  // read first: they arrive during the pass across
#pragma unroll
  for (int turn = 0; turn < kTurns; ++turn) {
    const int i = min(lane_of_thread() + turn * kWarp, columns - 1);
    if constexpr (kShown == Shown::given)
      values[turn] = {__ldg(image + i), __ldg(pictures.reference + place.value + i)};
    else if constexpr (kShown == Shown::gained)
      values[turn] =
          compared_gained(pictures, shown, __ldg(image + i), photo_value(__ldg(photo + 3 * i)),
                          pictures.mask ? pictures.mask + (place.pixel + i) : nullptr);
    else
      values[turn] = compared<kShown != Shown::plain>(
          pictures, place.channel, __ldg(image + i), photo_value(__ldg(photo + 3 * i)),
          pictures.mask ? pictures.mask + (place.pixel + i) : nullptr);
  }
  replace_by_means_across(means);
#pragma unroll
  for (int turn = 0; turn < kTurns; ++turn) {
    const int i = lane_of_thread() + turn * kWarp;
    const float X = values[turn].X, Y = values[turn].Y;
    const float sign = float(X > Y) - float(X < Y);
    const float dL_dX = l1 * sign + means[0][i] + 2.0f * X * means[1][i] + Y * means[2][i];
    if (i < columns)
      dL_dimage[place.value + i] =
          kShown == Shown::plain || kShown == Shown::given ? dL_dX : values[turn].gain * dL_dX;
    if (kShown == Shown::gained && i < columns) look_sum += dL_dX * values[turn].taught;
  }
}

/// From the derivatives of SSIM by the moments to dL/d(image). `look_sums` receives the sums of
/// each block where the appearance is learned.
template <Shown kShown>
__global__ void __launch_bounds__(kThreads, 6)
    image_gradient_kernel(Pictures pictures, float l1, Derivatives derivatives, float* dL_dimage,
                          float* look_sums) {
  alignas(16) __shared__ ColumnMeans<3> means;
  const Area area = area_of_block<kShown>(pictures);
  column_derivatives(pictures, area, derivatives, means);
  __syncthreads();

  const int columns = min(kBlockColumns, pictures.width - area.x0);
  const int rows = min(kBlockRows, pictures.height - area.y0);
  const std::int64_t plane = std::int64_t(pictures.width) * pictures.height;
  const ShownChannel shown = shown_channel<kShown>(pictures, area.channel);
  float look_sum = 0;
#pragma unroll 1
  for (int row = int(threadIdx.x) / kWarp; row < rows; row += kWarps) {
    const std::int64_t pixel = std::int64_t(area.y0 + row) * pictures.width + area.x0;
    const RowPlace place{area.channel, pixel, area.channel * plane + pixel};
    gradient_of_row<kShown>(pictures, shown, place, columns, l1, means[row], dL_dimage, look_sum);
  }
  if constexpr (kShown == Shown::gained) store_look_sum(look_sum, look_sums + blockIdx.x);
}

/// How blocks cover pictures, and what they leave.
struct Cover {
  std::size_t blocks, row_floats;

  Cover(int planes, int width, int height) {
    const std::size_t across = blocks_for(std::size_t(width), kBlockColumns);
    constexpr int kColumns = Derivatives::kColumns;
    blocks = planes * across * blocks_for(std::size_t(height), kBlockRows);
    row_floats = 3 * kColumns * blocks_for(across * kBlockColumns, kColumns);
  }
};

constexpr int kSumThreads = 256;

/// One block: the value of a comparison, from the sums of all warps.
__global__ void __launch_bounds__(kSumThreads)
    comparison_value_kernel(const float2* sums, std::size_t count, double l1, double ssim,
                            float* value) {
  __shared__ double of_warps[kSumThreads / kWarp][1];
  double sum[1] = {0};
  for (std::size_t i = threadIdx.x; i < count; i += kSumThreads)
    sum[0] += l1 * sums[i].x + ssim * sums[i].y;
  double total = 0;
  sum_of_block(sum, of_warps, &total);
  if (threadIdx.x == 0) *value = float(total);
}

class CudaLoss final : public Loss {
 public:
  CudaLoss(Context& context, Memory& memory, PhotoStore& photos)
      : context_(context), photos_(photos), derivatives_(memory), sums_(memory),
        look_sums_(memory) {}

  void forward_backward(const RenderPass& pass, const View& view, const LossSettings& settings,
                        Buffer<float>& dL_dimage) override {
    const Camera camera = reduced(view.camera, settings.photo_reduction);
    GS_CHECK(camera.width == pass.width && camera.height == pass.height);
    GS_CHECK(pass.image.size() == 3 * pass.pixel_count());
    const PhotoBytes bytes = photos_.photo(view, settings.photo_reduction);
    const PhotoOnDevice* const photo = settings.photo_on_device;
    const Pictures pictures{pass.image.data(),
                            bytes.photo,
                            pass.width,
                            pass.height,
                            int(blocks_for(std::size_t(pass.width), kBlockColumns)),
                            bytes.mask,
                            view.exposure,
                            pass.background,
                            view.over_background,
                            photo ? kPhotoWhite : view.white(),
                            PhotoLook(photo)};
    lambda_dssim_ = settings.lambda_dssim;
    values_ = 3 * pass.pixel_count();
    dL_dimage.resize_discard(values_);
    if (photo) {
      launch<Shown::gained>(pictures, dL_dimage.data());
      add_look_gradient(context_, look_sums_.span(), *photo);
    } else if (bytes.mask || view.has_exposure()) {
      launch<Shown::weighted>(pictures, dL_dimage.data());
    } else {
      launch<Shown::plain>(pictures, dL_dimage.data());
    }
  }

  double value() override {
    double l1_sum = 0, ssim_sum = 0;
    for (const float2& sum : sums_.download()) l1_sum += sum.x, ssim_sum += sum.y;
    return (1.0 - lambda_dssim_) * l1_sum / double(values_) +
           lambda_dssim_ * (1.0 - ssim_sum / double(values_));
  }

 private:
  template <Shown kShown>
  void launch(const Pictures& pictures, float* dL_dimage) {
    const Cover cover(3, pictures.width, pictures.height);
    derivatives_.resize_discard(3 * pictures.height * cover.row_floats);
    sums_.resize_discard(cover.blocks * kWarps);
    if (kShown == Shown::gained) look_sums_.resize_discard(cover.blocks);
    const Derivatives derivatives{derivatives_.data(), std::int64_t(cover.row_floats)};
    const float n = float(values_);

    StageScope scope(context_, "loss");
    context_.launch("loss", similarity_kernel<kShown>, cover.blocks, kThreads, pictures,
                    -lambda_dssim_ / n, derivatives, sums_.data());
    context_.launch("loss", image_gradient_kernel<kShown>, cover.blocks, kThreads, pictures,
                    (1.0f - lambda_dssim_) / n, derivatives, dL_dimage, look_sums_.data());
  }

  Context& context_;
  PhotoStore& photos_;
  Buffer<float> derivatives_;
  Buffer<float2> sums_;      // (blocks, warps of a block) sum |X - Y| and sum SSIM
  Buffer<float> look_sums_;  // (blocks) of learned appearances
  float lambda_dssim_ = 0;
  std::size_t values_ = 1;
};

}  // namespace

std::unique_ptr<Loss> make_loss(Context& context, Memory& memory, PhotoStore& photos) {
  return std::make_unique<CudaLoss>(context, memory, photos);
}

void compare_pictures(Context& context, Memory& scratch, const OperatorComparison& given,
                      float* value, float* dL_dimage) {
  const Cover cover(given.planes, given.width, given.height);
  Buffer<float> derivatives(given.planes * given.height * cover.row_floats, scratch);
  Buffer<float2> sums(cover.blocks * kWarps, scratch);
  const Pictures pictures{given.image,
                          nullptr,
                          given.width,
                          given.height,
                          int(blocks_for(std::size_t(given.width), kBlockColumns)),
                          nullptr,
                          Vec3f(1.0f),
                          Vec3f(0.0f),
                          false,
                          kPhotoWhite,
                          PhotoLook(nullptr),
                          given.reference,
                          given.planes,
                          given.margin};
  const auto mean_of = [&](int margin) {
    return 1.0 / (double(given.planes) * (given.width - 2 * margin) * (given.height - 2 * margin));
  };
  const double l1 = given.l1 * mean_of(0), ssim = given.ssim * mean_of(given.margin);
  const Derivatives to{derivatives.data(), std::int64_t(cover.row_floats)};
  context.launch("loss", similarity_kernel<Shown::given>, cover.blocks, kThreads, pictures,
                 float(ssim), to, sums.data());
  context.launch("loss", comparison_value_kernel, 1, kSumThreads, sums.data(), sums.size(), l1,
                 ssim, value);
  if (dL_dimage)
    context.launch("loss", image_gradient_kernel<Shown::given>, cover.blocks, kThreads, pictures,
                   float(l1), to, dL_dimage, nullptr);
}

}  // namespace gs::cuda
