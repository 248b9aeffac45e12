// SPDX-License-Identifier: Apache-2.0
// The pixels of a warp that blends on tensor cores. blend_gemm.cu explains the method.
#pragma once

#include "cuda/render/blend/splat_queue.cuh"

namespace gs::cuda {

// Transmittance of a pixel that takes no more fragments. As an unsigned number its bits are larger
// than those of any open pixel, so that one comparison finds the pixels that a batch ends.
inline constexpr float kClosed = -0.0f;

/// The pixels of one warp between batches, row by row of the sub-tile. In shared memory.
template <int height, bool with_history, bool with_depth>
struct PixelShared {
  // of two rows, before the next batch, or kClosed
  float2 transmittance[height / 2][kWarp];
  float4 sums[height / 2][kWarp];  // of the second product: a lane's part of two rows
  // a lane's part of the sum of depths of two rows
  float2 depths[with_depth ? height / 2 : 1][with_depth ? kWarp : 1];
  // 1 + position of a lane's last blended splat; 0: none
  std::uint32_t last[with_history ? height : 1][with_history ? kWarp : 1];
};

__device__ inline float of_partner(float value, int distance) {
  return __shfl_xor_sync(kAllLanes, value, distance);
}
__device__ inline float sum_of_owners(float value) {
  value += of_partner(value, 1);
  return value + of_partner(value, 2);
}
__device__ inline std::uint32_t greatest_of_owners(std::uint32_t value) {
  value = max(value, __shfl_xor_sync(kAllLanes, value, 1));
  return max(value, __shfl_xor_sync(kAllLanes, value, 2));
}

/// The pixels of a warp's sub-tile, whose corner is (x0, y0). `Kind` is a PixelVariant of
/// gemm_variants.cuh.
template <class Kind>
class SubtilePixels {
 public:
  using Queue = typename Kind::Queue;
  using Shared = PixelShared<Kind::height, Kind::with_history, Kind::with_depth>;
  static constexpr int kPairs = Kind::height / 2;  // of rows

  template <class Lists>
  __device__ SubtilePixels(Shared& shared, const Lists& lists, int x0, int y0) : shared_(shared) {
    // Monomials 1, x of owners 0 and 3; y, x^2 of owner 1; x y, y^2 of owner 2.
    const int t = owner();
    const float x = float(column()) - 0.5f * float(kSubtileWidth - 1);
    monomials_[0] = __floats2half2_rn(t % 3 == 0 ? 1.0f : 0.0f, t == 2 ? 0.0f : t == 1 ? x * x : x);
    monomials_[1] = __floats2half2_rn(t == 1 ? 1.0f : t == 2 ? x : 0.0f, 0.0f);
    monomials_[2] = __floats2half2_rn(0.0f, t == 2 ? 1.0f : 0.0f);
    open_pairs_ = (1u << min(kPairs, (lists.height - y0 + 1) / 2)) - 1;  // inside the picture
    // of this lane's column, inside the picture
    const int rows = x0 + column() < lists.width ? lists.height - y0 : 0;
    for (int pair = 0; pair < kPairs; ++pair) {
      shared_.transmittance[pair][lane_of_thread()] = {2 * pair < rows ? 1.0f : kClosed,
                                                       2 * pair + 1 < rows ? 1.0f : kClosed};
      shared_.sums[pair][lane_of_thread()] = {0, 0, 0, 0};
      if constexpr (Kind::with_depth) shared_.depths[pair][lane_of_thread()] = {0, 0};
    }
    if constexpr (Kind::with_history)
      for (int y = 0; y < Kind::height; ++y) shared_.last[y][lane_of_thread()] = 0;
    __syncwarp();
  }

  /// The whole warp: false where no pixel takes further fragments.
  __device__ bool any_open() const { return open_pairs_ != 0; }

  /// The whole warp: blends the next batch of the queue, or the last half batch.
  template <int batch>
  __device__ void blend(Queue& queue) {
    constexpr int products = products_of(batch);
    unsigned exponent_columns[products][2];
    queue.load_exponents(exponent_columns);
    float color_columns[products][2];
    queue.load_colors(color_columns);
    const __half2 one = __float2half2_rn(1.0f);
    __half2 y = __float2half2_rn(-0.5f * float(Kind::height - 1));
    const unsigned open_pairs = open_pairs_;
    RowPair pair(shared_);
#pragma unroll 1
    for (; pair.bit < (1u << kPairs); pair.next()) {
      const unsigned top = left_hand_side(y), bottom = left_hand_side(__hadd2(y, one));
      y = __hadd2(__hadd2(y, one), one);
      if (!(open_pairs & pair.bit)) continue;
      float exponents[products][4] = {};
#pragma unroll
      for (int j = 0; j < products; ++j)
        multiply_add_16x8x16(exponents[j], {top, bottom, top, bottom}, exponent_columns[j]);
      blend_rows(pair, exponents, color_columns, queue);
    }
    queue.pop(batch);
  }

  /// The column of the sub-tile that this lane has, and its number among the four lanes of that
  /// column.
  __device__ int column() const { return lane_of_thread() / kOwners; }
  __device__ int owner() const { return lane_of_thread() % kOwners; }
  /// The whole warp: this lane's channel of the two pixels in a pair of rows: red, green, blue, or
  /// transmittance. `behind` is the background in that channel, and 1 for the transmittance.
  __device__ float2 channel_of_pair(int pair, float behind) const {
    const float4 sums = shared_.sums[pair][lane_of_thread()];
    const float2 left = shared_.transmittance[pair][lane_of_thread()];
    return {channel(sums.x + sums.y, left.x, behind), channel(sums.z + sums.w, left.y, behind)};
  }
  /// The whole warp: the sums of weights times depths of the two pixels in a pair of rows.
  __device__ float2 depth_of_pair(int pair) const {
    const float2 part = shared_.depths[pair][lane_of_thread()];
    return {sum_of_owners(part.x), sum_of_owners(part.y)};
  }
  /// The whole warp: returns 1 + position of a pixel's last blended splat; 0: none.
  __device__ std::uint32_t last(int row) const {
    return greatest_of_owners(shared_.last[row][lane_of_thread()]);
  }

 private:
  // The channel of a pixel from the sum of the second product and the transmittance as shared
  // memory has it.
  __device__ float channel(float sum, float left, float behind) const {
    const float weights = __shfl_sync(kAllLanes, sum, kOwners - 1, kOwners);
    const float color = owner() < 3 ? sum : 0.0f;
    return fmaf(left > 0 ? left : transmittance_at_the_end(1.0f - weights), behind, color);
  }
  // The transmittance of a closed pixel from 1 - sum of its weights.
  __device__ static float transmittance_at_the_end(float left) {
    return Kind::rule == BlendRule::classic ? fmaxf(left, float(kMinTransmittance))
                                            : fminf(__saturatef(left), float(kMinTransmittance));
  }

  // This lane's part of a row of the exponents' left-hand side: two of 1, x, y, x^2, x y, y^2, 1,
  // x.
  __device__ unsigned left_hand_side(const __half2& y) const {
    const __half2 part = __hfma2(y, __hfma2(y, monomials_[2], monomials_[1]), monomials_[0]);
    return *reinterpret_cast<const unsigned*>(&part);
  }

  // This lane's two pixels of a pair of rows, one above the other: what shared memory holds of
  // them, and the bit of the pair in open_pairs_.
  struct RowPair {
    unsigned bit = 1;
    float2* transmittance;
    float4* sums;
    __device__ explicit RowPair(Shared& shared)
        : transmittance(&shared.transmittance[0][lane_of_thread()]),
          sums(&shared.sums[0][lane_of_thread()]) {}
    __device__ void next() {
      bit <<= 1;
      transmittance += kWarp;
      sums += kWarp;
    }
    __device__ int number() const { return __ffs(bit) - 1; }
  };

  // Blends a batch into two pixels, one above the other.
  template <int products>
  __device__ void blend_rows(const RowPair& pair, const float (&exponents)[products][4],
                             const float (&color_columns)[products][2], const Queue& queue) {
    constexpr int batch = 8 * products, owned = owned_of(batch);
    const float2 open_ = *pair.transmittance;
    const float open[2] = {open_.x, open_.y};
    // This lane's fragments on their own: their weights, and the light that they let through.
    float weights[owned][2], light[2] = {kLight, kLight};
    int last[2] = {-1, -1};
#pragma unroll
    for (int i = 0; i < owned; ++i)
#pragma unroll
      for (int r = 0; r < 2; ++r) {
        float kept = exp2_fragment(exponents[i / 2][2 * r + i % 2]) * kLeast;
        if (Kind::rule == BlendRule::classic) kept = fminf(kept, float(kMaxAlphaClassic) / kLight);
        if (Kind::with_history && kept > 0) last[r] = i;
        weights[i][r] = kept * light[r];
        light[r] = fmaf(-kLight, weights[i][r], light[r]);
      }
    // The light that reaches them, and the light behind the whole batch.
    float reaching[2], left[2];
#pragma unroll
    for (int r = 0; r < 2; ++r) {
      // Rounding may make the light behind an opaque splat negative.
      const float through = __saturatef(light[r] * (1.0f / kLight));
      const float next = of_partner(through, 1), two = through * next;
      const float other_two = of_partner(two, 2);
      reaching[r] = open[r];
      if (owner() & 1) reaching[r] *= next;
      if (owner() & 2) reaching[r] *= other_two;
      left[r] = open[r] * (two * other_two);
    }
    const unsigned least = __float_as_uint(float(kMinTransmittance));
    if (__any_sync(kAllLanes, min(__float_as_uint(left[0]), __float_as_uint(left[1])) < least)) {
#pragma unroll
      for (int r = 0; r < 2; ++r) {
        const bool ends = __float_as_uint(left[r]) < least;
        if (!__any_sync(kAllLanes, ends)) {
          scale(weights, r, reaching[r]);
          continue;
        }
        weigh_to_the_end(weights, r, reaching[r], last[r]);
        if (ends) left[r] = kClosed;
      }
      // A closed pixel is -0.
      if (!__any_sync(kAllLanes, fmaxf(left[0], left[1]) > 0)) open_pairs_ &= ~pair.bit;
    } else {
      scale(weights, 0, reaching[0]);
      scale(weights, 1, reaching[1]);
    }
    add_colors(*pair.sums, weights, color_columns);
    if constexpr (Kind::with_depth) add_depths(pair, weights, queue);
    *pair.transmittance = {left[0], left[1]};
    if constexpr (Kind::with_history)
#pragma unroll
      for (int r = 0; r < 2; ++r)
        if (last[r] >= 0 && open[r] > 0)
          shared_.last[2 * pair.number() + r][lane_of_thread()] =
              queue.position(batch, last[r]) + 1;
  }

  // Scales a row's weights by the light that reaches them.
  template <int owned>
  __device__ static void scale(float (&weights)[owned][2], int r, float reaching) {
#pragma unroll
    for (int i = 0; i < owned; ++i) weights[i][r] *= reaching;
  }

  // The same weights where the pixel may become opaque among them: fragments behind that point get
  // weight 0.
  template <int owned>
  __device__ static void weigh_to_the_end(float (&weights)[owned][2], int r, float reaching,
                                          int& last) {
    last = -1;
    float through = 1;
    // Below it, through * reaching is opaque. A closed pixel has -infinity and weights of 0.
    const float least = float(kMinTransmittance) / reaching;
#pragma unroll
    for (int i = 0; i < owned; ++i) {
      const float after = through - weights[i][r];
      const bool is_blended = (Kind::rule == BlendRule::classic ? after : through) >= least;
      weights[i][r] = is_blended ? weights[i][r] * reaching : 0.0f;
      if (Kind::with_history && weights[i][r] > 0) last = i;
      through = after;
    }
  }

  // sums += [pixels x splats] [splats x colors]
  template <int owned, int products>
  __device__ static void add_colors(float4& sums, const float (&weights)[owned][2],
                                    const float (&columns)[products][2]) {
    float high[4] = {sums.x, sums.y, sums.z, sums.w}, low[4] = {};
#pragma unroll
    for (int j = 0; j < products; ++j) {
      const float part[4] = {weights[2 * j][0], weights[2 * j][1], weights[2 * j + 1][0],
                             weights[2 * j + 1][1]};
      multiply_add_in_parts(high, low, part, columns[j]);
    }
    sums = {high[0] + low[0], high[1] + low[1], high[2] + low[2], high[3] + low[3]};
  }

  template <int owned>
  __device__ void add_depths(const RowPair& pair, const float (&weights)[owned][2],
                             const Queue& queue) const {
    const float4* const depths = queue.depths(owned * kOwners);
    float2& sums = shared_.depths[pair.number()][lane_of_thread()];
    float2 sum = sums;
#pragma unroll
    for (int i = 0; i < owned; i += 4) {
      const float4 z = depths[i / 4];
      sum.x = fmaf(weights[i][0], z.x, fmaf(weights[i + 1][0], z.y, sum.x));
      sum.x = fmaf(weights[i + 2][0], z.z, fmaf(weights[i + 3][0], z.w, sum.x));
      sum.y = fmaf(weights[i][1], z.x, fmaf(weights[i + 1][1], z.y, sum.y));
      sum.y = fmaf(weights[i + 2][1], z.z, fmaf(weights[i + 3][1], z.w, sum.y));
    }
    sums = sum;
  }

  Shared& shared_;
  // This lane's part of the exponents' left-hand side as a polynomial of y, exact in fp16.
  __half2 monomials_[3];
  unsigned open_pairs_;  // a bit for each pair of rows that takes further fragments
};

/// The whole warp: blends a batch. A queue with fewer splats is filled up to half a batch or a
/// whole one.
template <class Queue, class Pixels>
__device__ void blend_next(Queue& queue, Pixels& pixels) {
  if (queue.count() <= kHalfBatch) {
    queue.fill_up(kHalfBatch);
    pixels.template blend<kHalfBatch>(queue);
  } else {
    queue.fill_up(kBatch);
    pixels.template blend<kBatch>(queue);
  }
}

}  // namespace gs::cuda
