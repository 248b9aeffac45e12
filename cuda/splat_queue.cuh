// SPDX-License-Identifier: Apache-2.0
// The splats that hit a sub-tile and wait to be blended, 32 at a time, by blend_gemm.cu: in shared memory, one queue of
// each warp, as the right-hand sides of its two matrix products.
//
//   exponents  [pixels x 6] [6 x splats]        a splat is a column of six coefficients, relative to the sub-tile's center,
//                                               each as two halves: 22 bits, and the first two as three
//   colors    [pixels x splats] [splats x 8]   a splat is a row: each channel in a part that TF32 holds and the rest, then
//                                               1 and 0; the 1 sums the weights
//
// A batch is four products of exponents with 8 columns each, half a batch two; gemm_layout.h says which splat is which column.
#pragma once

#include <cuda_fp16.h>

#include "cuda/gemm_layout.h"
#include "cuda/mma.cuh"
#include "cuda/subtile.cuh"

namespace gs::cuda {

static_assert(kBatch == kWarp);
inline constexpr int kColorParts = 6;  // red, green, blue in two parts each

/// One warp's room for one batch or two. Positions are kept only for those who ask.
template <bool with_positions, unsigned places>
struct QueueRoom {
  uint4 high[places], low[places];  // eight halves, times 1, x, y, x^2, x y, y^2, 1, x
  float2 colors[places][kColorParts / 2];
  std::uint32_t positions[places];  // in the tile's list
};
template <unsigned places>
struct QueueRoom<false, places> {
  uint4 high[places], low[places];
  float2 colors[places][kColorParts / 2];
};

/// A queue with room for one batch takes up to a batch when it is empty; one for two takes one while another waits.
template <bool with_positions, unsigned places>
class SplatQueue {
 public:
  using Room = QueueRoom<with_positions, places>;

  /// `center` of the sub-tile, in pixels.
  __device__ SplatQueue(Room& room, const Vec2f& center) : room_(room), center_(center) {}

  __device__ unsigned count() const { return count_; }

  /// The whole warp: takes what hits of the next 32 splats that are found. Less than a batch may be waiting, and nothing where there is room for one.
  template <class Walk>
  __device__ void take(Walk& walk) {
    count_ += walk.take_next([&](int k, const Splat& splat, std::uint32_t position, std::uint32_t) {
      ExponentTerms<float> terms = exponent_coefficients(
          conic_factors(splat.conic, splat.variance_y), splat.mean2d - center_,
          __log2f(splat.opacity * (1.0f / kMinAlpha)));
      // So far from the center no fragment is near, and half precision would not hold the coefficients.
      if (!(terms.of[0] > kFarAway)) terms = nobody_sees();
      put(count_ + k, terms, splat.color, position);
    });
  }

  /// The whole warp: fills the batch, or half of it, up with splats that nobody sees.
  __device__ void fill_up(unsigned batch) {
    if (lane_of_thread() >= count_ && lane_of_thread() < batch)
      put(lane_of_thread(), nobody_sees(), {0, 0, 0}, 0);
    count_ = max(count_, batch);
    __syncwarp();
  }

  /// The right-hand sides of the exponents of the next batch: high halves, then low ones.
  template <int products>
  __device__ void load_exponents(unsigned (&columns)[products][2]) const {
    const unsigned lane = lane_of_thread(), matrix = lane / 8;
#pragma unroll
    for (unsigned j = 0; j < products; j += 2) {
      const unsigned row = begin_ + place_of_column(8 * products, j + matrix / 2, lane % 8);
      unsigned words[4];
      load_four_matrices(words, matrix % 2 ? &room_.low[row] : &room_.high[row]);
      columns[j][0] = words[0];
      columns[j][1] = words[1];
      columns[j + 1][0] = words[2];
      columns[j + 1][1] = words[3];
    }
  }

  /// The right-hand sides of the colors of the next batch: rows t and t + 4 of product j are splats 2 j and 2 j + 1 of
  /// lane t of a pixel's four.
  template <int products>
  __device__ void load_colors(float (&columns)[products][2]) const {
    const int lane = lane_of_thread(), column = lane / kOwners;
    const float* const from = &room_.colors[begin_ + lane % kOwners * owned_of(8 * products)][0].x;
#pragma unroll
    for (int i = 0; i < owned_of(8 * products); ++i)
      columns[i / 2][i % 2] = column < kColorParts    ? from[i * kColorParts + column]
                              : column == kColorParts ? 1.0f
                                                      : 0.0f;
  }

  /// Where the i-th of the splats that this lane has of the next batch stands in the list.
  __device__ std::uint32_t position(int batch, unsigned i) const {
    return room_.positions[begin_ + lane_of_thread() % kOwners * owned_of(batch) + i];
  }

  /// The whole warp: drops the next batch, or the last half.
  __device__ void pop(unsigned batch) {
    begin_ = (begin_ + kBatch) % places;
    count_ -= batch;
    __syncwarp();
  }

 private:
  // |u|^2 of a sub-tile's center; |u| changes by less than 30 to its corners.
  static constexpr float kFarAway = -4096.0f;
  __device__ static ExponentTerms<float> nobody_sees() { return {{kFarAway, 0, 0, 0, 0, 0}}; }
  __device__ static float2 minus(const float2& a, const __half2& halves) {
    const float2 b = __half22float2(halves);
    return {a.x - b.x, a.y - b.y};
  }
  __device__ void put(unsigned k, const ExponentTerms<float>& terms, const Vec3f& color,
                      std::uint32_t position) {
    const unsigned place = (begin_ + k) % places;
    const unsigned column = place / kBatch * kBatch + place_of_splat(place % kBatch);
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
  Vec2f center_;
  unsigned begin_ = 0, count_ = 0;  // of the next batch in the room: 0 or kBatch; splats from there on
};

}  // namespace gs::cuda
