// SPDX-License-Identifier: Apache-2.0
// The queue of splats that hit a sub-tile and that blend_gemm.cu blends 32 at a time. Each warp has
// one queue in shared memory. It holds the splats as right-hand sides of two matrix products:
//
//   exponents  [pixels x 6] [6 x splats]
//              A splat is a column of six coefficients about the sub-tile's center. A coefficient v
//              is hi + lo, two fp16 numbers with 22 bits together. The first two coefficients are
//              the largest and get a third fp16 number.
//   colors     [pixels x splats] [splats x 8]
//              A splat is a row: a TF32 part and the rest of each channel, then 1 and 0. The column
//              of ones sums the weights.
//
// A batch is four products of exponents with 8 columns each, half a batch is two. gemm_layout.h
// maps splats to columns.
#pragma once

#include <cuda_fp16.h>

#include "cuda/device/mma.cuh"
#include "cuda/render/blend/gemm_layout.h"
#include "cuda/render/blend/subtile.cuh"

namespace gs::cuda {

static_assert(kBatch == kWarp);
inline constexpr int kColorColumns = 8;  // red, green, blue in two parts each, then 1 and 0

/// The colors of a batch as columns of the product, one after the other. A column has the places of
/// a batch and four more, so that columns begin in different banks of shared memory.
struct alignas(16) QueueColors {
  float columns[kColorColumns][kBatch + 4];
};

// A fragment is dropped where 255 alpha < 1. The product (255 alpha) kLeast flushes to zero exactly
// there, since kLeast is the smallest normal number, so that no comparison is needed. Light is
// scaled by kLight = 1 / (255 kLeast) to make up for both factors.
inline constexpr float kLeast = 0x1p-126f;
inline constexpr float kLight = float(kMinAlpha) / kLeast;

/// Shared memory of one warp's queue, for one batch or two. Positions are stored only for the
/// backward pass, and depths where they are blended.
template <bool with_positions, bool with_depth, unsigned places>
struct QueueShared {
  uint4 high[places], low[places];  // eight fp16 each, factors of 1, x, y, x^2, x y, y^2, 1, x
  QueueColors colors[places / kBatch];
  alignas(16) float depths[with_depth ? places : 4];
  std::uint32_t positions[with_positions ? places : 4];  // in the tile's list
};

/// What a queue takes of a splat: the factors of its conic, log2(255 opacity), and its color, raised
/// to RenderPass::least_color. The colors of a ViewSplat are not below 0.
__device__ inline ConicFactors<float> factors_of(const Splat& splat) {
  return conic_factors(splat.conic, splat.variance_y);
}
__device__ inline float log2_opacity(const Splat& splat) {
  return __log2f(splat.opacity * (1.0f / kMinAlpha));
}
__device__ inline Vec3f color_of(const Splat& splat, float least) {
  return {fmaxf(splat.color.x, least), fmaxf(splat.color.y, least), fmaxf(splat.color.z, least)};
}
__device__ inline float depth_of(const Splat& splat) { return splat.depth; }
__device__ inline ConicFactors<float> factors_of(const ViewSplat& splat) { return splat.L; }
__device__ inline float depth_of(const ViewSplat&) { return 0; }
__device__ inline float log2_opacity(const ViewSplat& splat) { return splat.log2_opacity; }
__device__ inline Vec3f color_of(const ViewSplat& splat, float) {
  return unpacked_color(splat.color);
}

/// A queue of one batch must be empty when it takes splats. A queue of two batches takes splats
/// while less than one batch waits.
template <bool with_positions, bool with_depth, unsigned places>
class SplatQueue {
 public:
  using Shared = QueueShared<with_positions, with_depth, places>;
  static constexpr bool has_one_batch = places == kBatch;

  /// `center` of the sub-tile, in pixels.
  __device__ SplatQueue(Shared& shared, const Vec2f& center) : shared_(shared), center_(center) {
    for (QueueColors& colors : shared_.colors) {
      colors.columns[kColorColumns - 2][lane_of_thread()] = 1;
      colors.columns[kColorColumns - 1][lane_of_thread()] = 0;
    }
  }

  __device__ unsigned count() const { return count_; }

  /// The whole warp: takes splats until a batch waits, or those that are left of the walk's
  /// segment.
  template <class Walk>
  __device__ void take_batch(Walk& walk) {
    if constexpr (has_one_batch)
      take(walk);  // as many as are left, up to a batch
    else
      while (count_ < kBatch && !walk.segment_is_done()) take(walk);
  }

  /// The whole warp: takes those of the walk's next 32 splats that hit the pixels.
  template <class Walk>
  __device__ void take(Walk& walk) {
    count_ += walk.take_next([&](int k, const auto& splat, std::uint32_t position, std::uint32_t) {
      ExponentTerms<float> terms =
          exponent_coefficients(factors_of(splat), splat.mean2d - center_, log2_opacity(splat));
      // A splat this far away is invisible at every pixel, and its coefficients would overflow
      // fp16.
      if (!(terms.of[0] > kFarAway)) terms = invisible();
      put(has_one_batch ? k : count_ + k, terms, color_of(splat, walk.least_color()),
          depth_of(splat), position);
    });
  }

  /// The whole warp: fills up the batch, or half a batch, with invisible splats.
  __device__ void fill_up(unsigned batch) {
    if (count_ >= batch) return;
    if (lane_of_thread() >= count_ && lane_of_thread() < batch)
      put(lane_of_thread(), invisible(), {0, 0, 0}, 0, 0);
    count_ = batch;
    __syncwarp();
  }

  /// The right-hand sides of the exponents of the next batch: the hi numbers, then the lo numbers.
  template <int products>
  __device__ void load_exponents(unsigned (&columns)[products][2]) const {
    const unsigned lane = lane_of_thread(), matrix = lane / 8;
#pragma unroll
    for (unsigned j = 0; j < products; j += 2) {
      const unsigned row = begin_ + place_of_column(8 * products, j + matrix / 2, lane % 8);
      unsigned words[4];
      load_four_matrices(words, matrix % 2 ? &shared_.low[row] : &shared_.high[row]);
      columns[j][0] = words[0];
      columns[j][1] = words[1];
      columns[j + 1][0] = words[2];
      columns[j + 1][1] = words[3];
    }
  }

  /// The right-hand sides of the colors of the next batch: rows t and t + 4 of product j are splats
  /// 2 j and 2 j + 1 of lane t of a pixel's four. Of a whole batch, each four rows are the 16 bytes
  /// that ldmatrix takes at a time.
  template <int products>
  __device__ void load_colors(float (&columns)[products][2]) const {
    const QueueColors& colors = shared_.colors[begin_ / kBatch];
    const unsigned lane = lane_of_thread();
    if constexpr (products == products_of(kBatch)) {
#pragma unroll
      for (unsigned j = 0; j < products; j += 2) {
        unsigned words[4];
        load_four_matrices(words, &colors.columns[lane % 8][(2 * j + lane / 8) * kOwners]);
#pragma unroll
        for (unsigned i = 0; i < 4; ++i) columns[j + i / 2][i % 2] = __uint_as_float(words[i]);
      }
    } else {
      const float* const from =
          &colors.columns[lane / kOwners][place_of_color(lane % kOwners * owned_of(8 * products))];
#pragma unroll
      for (unsigned i = 0; i < owned_of(8 * products); ++i)
        columns[i / 2][i % 2] = from[place_of_color(i)];
    }
  }

  /// The position in the tile's list of this lane's i-th splat of the next batch.
  __device__ std::uint32_t position(int batch, unsigned i) const {
    return shared_.positions[begin_ + lane_of_thread() % kOwners * owned_of(batch) + i];
  }

  /// The depths of this lane's splats of the next batch.
  __device__ const float4* depths(int batch) const {
    return reinterpret_cast<const float4*>(shared_.depths + begin_ +
                                           lane_of_thread() % kOwners * owned_of(batch));
  }

  /// The whole warp: drops the next batch, or the last half. The walk that brings the splats after
  /// it synchronizes the warp before a queue of one batch takes them.
  __device__ void pop(unsigned batch) {
    begin_ = (begin_ + kBatch) % places;
    count_ -= batch;
    if constexpr (!has_one_batch) __syncwarp();
  }

 private:
  // Limit of -|u|^2 at a sub-tile's center. From there to a corner, |u| changes by less than 30.
  static constexpr float kFarAway = -4096.0f;
  __device__ static ExponentTerms<float> invisible() { return {{kFarAway, 0, 0, 0, 0, 0}}; }
  __device__ static float2 minus(const float2& a, const __half2& halves) {
    const float2 b = __half22float2(halves);
    return {a.x - b.x, a.y - b.y};
  }
  __device__ void put(unsigned k, const ExponentTerms<float>& terms, const Vec3f& color,
                      float depth, std::uint32_t position) {
    const unsigned place = has_one_batch ? k : (begin_ + k) % places;
    const unsigned column = place / kBatch * kBatch + place_of_splat(place % kBatch);
    __half2 high[4], low[4];
    float2 rest;
#pragma unroll
    for (int i = kExponentTerms - 2; i >= 0; i -= 2) {
      high[i / 2] = __floats2half2_rn(terms.of[i], terms.of[i + 1]);
      rest = minus(make_float2(terms.of[i], terms.of[i + 1]), high[i / 2]);
      low[i / 2] = __floats2half2_rn(rest.x, rest.y);
    }
    // The third fp16 number of the first two coefficients.
    rest = minus(rest, low[0]);
    high[3] = __floats2half2_rn(rest.x, rest.y);
    low[3] = __floats2half2_rn(0.0f, 0.0f);
    shared_.high[column] = *reinterpret_cast<const uint4*>(high);
    shared_.low[column] = *reinterpret_cast<const uint4*>(low);
    QueueColors& colors = shared_.colors[place / kBatch];
    const unsigned row = place_of_color(place % kBatch);
#pragma unroll
    for (int c = 0; c < 3; ++c) {
      const float part = tf32_part(color[c]);
      colors.columns[2 * c][row] = part;
      colors.columns[2 * c + 1][row] = color[c] - part;
    }
    if constexpr (with_depth) shared_.depths[place] = depth;
    if constexpr (with_positions) shared_.positions[place] = position;
  }

  Shared& shared_;
  Vec2f center_;
  unsigned begin_ = 0, count_ = 0;  // place of the next batch: 0 or kBatch; splats from there on
};

}  // namespace gs::cuda
