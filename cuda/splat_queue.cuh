// SPDX-License-Identifier: Apache-2.0
// The splats that hit a sub-tile and wait to be blended, 32 at a time, by blend_gemm.cu: in shared memory, one queue of
// each warp, as the right-hand sides of its two matrix products.
//
//   exponents  [pixels x 6] [6 x splats]        a splat is a column of six coefficients, relative to the sub-tile's centre,
//                                               each as two halves: 22 bits, and the first two as three
//   colours    [pixels x splats] [splats x 8]   a splat is a row: each channel in a part that TF32 holds and the rest, then
//                                               1 and 0; the 1 sums the weights
//
// A batch is four products of exponents with 8 columns each; gemm_layout.h says which splat is which column.
#pragma once

#include <cuda_fp16.h>

#include "cuda/gemm_layout.h"
#include "cuda/mma.cuh"
#include "cuda/subtile.cuh"

namespace gs::cuda {

static_assert(kBatch == kWarp);
inline constexpr int kColorParts = 6;  // red, green, blue in two parts each

/// One warp's queue has room for two batches. Positions are kept only for those who ask.
template <bool with_positions>
struct QueueRoom {
  uint4 high[2 * kBatch], low[2 * kBatch];  // eight halves, times 1, x, y, x^2, x y, y^2, 1, x
  float2 colors[2 * kBatch][kColorParts / 2];
  std::uint32_t positions[2 * kBatch];      // in the tile's list
};
template <>
struct QueueRoom<false> {
  uint4 high[2 * kBatch], low[2 * kBatch];
  float2 colors[2 * kBatch][kColorParts / 2];
};

template <bool with_positions>
class SplatQueue {
 public:
  using Room = QueueRoom<with_positions>;

  /// `centre` of the sub-tile, in pixels.
  __device__ SplatQueue(Room& room, const Vec2f& centre) : room_(room), centre_(centre) {}

  __device__ unsigned count() const { return count_; }

  /// The whole warp: takes what hits of the next 32 splats of the list. At most a batch may be waiting.
  __device__ void take(ListWalk& walk) {
    count_ += walk.take_next([&](int k, const Splat& splat, std::uint32_t position, std::uint32_t) {
      put(count_ + k,
          exponent_coefficients(conic_factors(splat.conic, splat.variance_y),
                                splat.mean2d - centre_, __log2f(splat.opacity)),
          splat.color, position);
    });
  }

  /// The whole warp: fills the batch up with splats that nobody sees.
  __device__ void fill_up() {
    constexpr float kNeverVisible = -30000.0f;  // an exponent that half precision holds
    if (count_ >= kBatch) return;
    if (lane_of_thread() >= count_)
      put(lane_of_thread(), {{kNeverVisible, 0, 0, 0, 0, 0}}, {0, 0, 0}, 0);
    count_ = kBatch;
    __syncwarp();
  }

  /// The right-hand sides of the exponents of the next batch: high halves, then low ones.
  __device__ void load_exponents(unsigned (&columns)[kProducts][2]) const {
    const unsigned lane = lane_of_thread(), matrix = lane / 8;
#pragma unroll
    for (unsigned j = 0; j < kProducts; j += 2) {
      const unsigned row = begin_ + 8 * (j + matrix / 2) + lane % 8;
      unsigned words[4];
      load_four_matrices(words, matrix % 2 ? &room_.low[row] : &room_.high[row]);
      columns[j][0] = words[0];
      columns[j][1] = words[1];
      columns[j + 1][0] = words[2];
      columns[j + 1][1] = words[3];
    }
  }

  /// The right-hand sides of the colours of the next batch: rows t and t + 4 of product j are splats 2 j and 2 j + 1 of
  /// lane t of a pixel's four.
  __device__ void load_colors(float (&columns)[kProducts][2]) const {
    const int lane = lane_of_thread(), column = lane / kOwners;
    const float* const from = &room_.colors[begin_ + lane % kOwners * kOwned][0].x;
#pragma unroll
    for (int i = 0; i < kOwned; ++i)
      columns[i / 2][i % 2] = column < kColorParts    ? from[i * kColorParts + column]
                              : column == kColorParts ? 1.0f
                                                      : 0.0f;
  }

  /// Where the i-th of this lane's splats of the next batch stands in the list.
  __device__ std::uint32_t position(unsigned i) const {
    return room_.positions[begin_ + lane_of_thread() % kOwners * kOwned + i];
  }

  /// The whole warp: drops the next batch.
  __device__ void pop_batch() {
    begin_ ^= kBatch;
    count_ -= kBatch;
    __syncwarp();
  }

 private:
  __device__ static float2 minus(const float2& a, const __half2& halves) {
    const float2 b = __half22float2(halves);
    return {a.x - b.x, a.y - b.y};
  }
  __device__ void put(unsigned k, const ExponentTerms<float>& terms, const Vec3f& color,
                      std::uint32_t position) {
    const unsigned place = (begin_ + k) % (2 * kBatch);
    const unsigned column = place / kBatch * kBatch + column_of_splat(place % kBatch);
    __half2 high[4], low[4];
    float2 rest;
#pragma unroll
    for (int i = kExponentTerms - 2; i >= 0; i -= 2) {
      high[i / 2] = __floats2half2_rn(terms.of[i], terms.of[i + 1]);
      rest = minus(make_float2(terms.of[i], terms.of[i + 1]), high[i / 2]);
      low[i / 2] = __floats2half2_rn(rest.x, rest.y);
    }
    // What is then still left of the first two, which are the largest.
    rest = minus(rest, low[0]);
    high[3] = __floats2half2_rn(rest.x, rest.y);
    low[3] = __floats2half2_rn(0.0f, 0.0f);
    room_.high[column] = *reinterpret_cast<const uint4*>(high);
    room_.low[column] = *reinterpret_cast<const uint4*>(low);
#pragma unroll
    for (int c = 0; c < 3; ++c) {
      const float channel = fmaxf(color[c], 0.0f), part = tf32_part(channel);
      room_.colors[place][c] = {part, channel - part};
    }
    if constexpr (with_positions) room_.positions[place] = position;
  }

  Room& room_;
  Vec2f centre_;
  unsigned begin_ = 0, count_ = 0;  // of the next batch in the room: 0 or kBatch; splats from there on
};

}  // namespace gs::cuda
