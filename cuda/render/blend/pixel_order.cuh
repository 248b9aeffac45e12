// SPDX-License-Identifier: Apache-2.0
// How a warp walks a tile's list in the order by pixel, for the blending kernel and its backward
// pass. Each lane has a pixel of the sub-tile. Three sorts follow one another, each finer than the
// one before:
//   list    by the depths at each splat's best point of the tile (render/pixel_order.cu)
//   warp    of the splats that hit the sub-tile, by the depths at their best point of it: each lane
//           holds one, 32 arrive, and the nearest 32 of both pass on
//   pixel   of the fragments of each pixel, by the depths along its ray (pixel_window.h)
// So lanes blend different splats at the same time.   Radl et al. 2024 (StopThePop), whose queues
// have other sizes
#pragma once

#include "cuda/render/blend/pixel_window.h"
#include "cuda/render/blend/subtile.cuh"

namespace gs::cuda {

/// One warp a block: shared memory allows few warps on a multiprocessor, and they share nothing.
inline constexpr int kPixelOrderThreads = kWarp;
inline std::size_t pixel_order_blocks(std::size_t tiles) { return tiles * kSubtilesPerTile; }

/// Of the keys of two lanes that differ by one bit, the smaller or the larger one.
__device__ inline std::uint32_t exchange_key(std::uint32_t key, int distance, bool takes_smaller) {
  const std::uint32_t other = __shfl_xor_sync(kAllLanes, key, distance);
  return takes_smaller ? min(key, other) : max(key, other);
}
/// Sorts the keys of the lanes, which rise and then fall or fall and then rise.
__device__ inline void sort_lanes_bitonic(std::uint32_t& key) {
  const int lane = lane_of_thread();
#pragma unroll
  for (int distance = kWarp / 2; distance > 0; distance /= 2)
    key = exchange_key(key, distance, (lane & distance) == 0);
}
/// Sorts any keys of the lanes, the largest first (Batcher 1968).
__device__ inline void sort_lanes_falling(std::uint32_t& key) {
  const int lane = lane_of_thread();
#pragma unroll
  for (int size = 2; size <= kWarp; size *= 2)
#pragma unroll
    for (int distance = size / 2; distance > 0; distance /= 2)
      key = exchange_key(key, distance, ((lane & distance) == 0) == ((lane & size) != 0));
}

template <bool with_depth>
class PixelOrderWalk {
  using Walk = PartWalkOf<Splat, kTileWidth, false>;

 public:
  using Listed = gs::cuda::Listed<with_depth>;
  /// Of one warp.
  struct Shared {
    Listed listed[kPlaces];                  // splats that pixels wait with
    RayDepth<float> rays[kWindow];           // of the batch
    std::uint8_t going[2 * kWindow][kWarp];  // places of the fragments that each pixel blends next
    Listed waiting[2 * kWarp];               // splats that the warp holds, and that arrive
    RayDepth<float> waiting_rays[2 * kWarp];
    typename Walk::Ahead ahead;
  };

  __device__ PixelOrderWalk(Shared& shared, const TileLists& lists, const RayDepth<float>* rays,
                            const Subtile& subtile)
      : shared_(shared), rays_(rays), pixels_(subtile.pixels()), x_(float(subtile.x) + 0.5f),
        y_(float(subtile.y) + 0.5f),
        walk_(shared.ahead, lists, subtile.tile, pixels_.bit(), 0,
              lists.ranges[subtile.tile + 1] - lists.ranges[subtile.tile], false) {}

  /// Nothing is left: pixels have blended all, or none of them was open.
  __device__ bool is_done() const { return is_done_; }
  /// The quarter of the places that the next batch takes; nobody waits with what is there.
  __device__ int next_quarter() const { return quarter_; }
  /// The splats of a quarter.
  __device__ int listed_in(int quarter) const { return int(counts_ >> 8 * quarter & 255u); }

  /// The whole warp: takes the next batch. Calls keep(place, splat, exponent, is_kept) for each of
  /// its places, in order; a splat is not kept where this lane's pixel has no fragment or is not
  /// open. Then calls blend(place, splat) for fragments of this lane's pixel in their order; after
  /// the last splats, and where no pixel is open, for all that are left.
  template <class Keep, class Blend>
  __device__ void take(bool is_open, const Keep& keep, const Blend& blend) {
    const int first = quarter_ * kWindow, lane = lane_of_thread();
    const bool any_open = __any_sync(kAllLanes, is_open);
    while (any_open && passing_ == 0 && !has_passed_all_) let_pass();
    const int count = any_open ? min(passing_, kWindow) : 0;
    const int slot = slot_of(__shfl_sync(kAllLanes, passes_, kWarp - passing_ + lane));
    if (lane < count) {
      shared_.listed[first + lane] = shared_.waiting[slot];
      shared_.rays[lane] = shared_.waiting_rays[slot];
    }
    passing_ -= count;
    is_done_ = !any_open || (passing_ == 0 && has_passed_all_);
    counts_ = (counts_ & ~(255u << 8 * quarter_)) | std::uint32_t(count) << 8 * quarter_;
    __syncwarp();
    WindowKeys arriving;
#pragma unroll
    for (int k = 0; k < kWindow; ++k) {
      const Listed& splat = shared_.listed[first + k];
      const float dx = x_ - splat.mean2d.x, dy = y_ - splat.mean2d.y;
      const float e = base2_exponent(splat, dx, dy), depth = shared_.rays[k].at(dx, dy);
      const bool is_kept = k < count && is_open && e >= splat.lowest && depth > 0.0f;
      arriving.of[k] = is_kept ? window_key(depth, first + k) : 0u;
      keep(first + k, splat, e, is_kept);
    }
    merge(held_, arriving);
    quarter_ = (quarter_ + 1) % kQuarters;
    const int going_of_held = is_done_ ? kWindow : count_up_to_quarter(held_, quarter_);
    int going = 0;
#pragma unroll
    for (int i = 0; i < kWindow; ++i)
      if (arriving.of[i]) shared_.going[going++][lane] = std::uint8_t(place_of_key(arriving.of[i]));
#pragma unroll
    for (int i = 0; i < kWindow; ++i) {
      if (i >= going_of_held) continue;
      if (held_.of[i]) shared_.going[going++][lane] = std::uint8_t(place_of_key(held_.of[i]));
      held_.of[i] = 0;
    }
    const int longest = warp_max(going);
    for (int i = 0; i < longest; ++i) {
      if (i >= going) continue;
      const int place = shared_.going[i][lane];
      blend(place, shared_.listed[place]);
    }
    __syncwarp();
  }

 private:
  // A key of the warp's sort: a depth above 0, whose last bits number the splat's slot of
  // `waiting`, or the number alone. All slots are those of passes_ and holds_.
  static constexpr std::uint32_t kSlotBits = 2 * kWarp - 1;
  static_assert((kSlotBits & 2 * kWarp) == 0);
  __device__ static int slot_of(std::uint32_t key) { return int(key & kSlotBits); }
  __device__ static bool has_splat(std::uint32_t key) { return key > kSlotBits; }

  // The whole warp: the next 32 of the list arrive, in the slots of those that have passed. The
  // nearest of them and of those that are held pass on; after the end of the list all that are held.
  __device__ void let_pass() {
    if (walk_.is_done()) {
      passes_ = holds_;
      has_passed_all_ = true;
    } else {
      const int slot = slot_of(passes_);
      passes_ = std::uint32_t(slot);
      walk_.take_next([&](int, const Splat& splat, std::uint32_t, std::uint32_t gaussian) {
        const LeastPoint best =
            least_in_rectangle(splat.mean2d, splat.conic, pixels_.x_min, pixels_.x_max,
                               pixels_.y_min, pixels_.y_max, kSubtileSlack);
        if (best.value > splat.cutoff) return;
        const RayDepth<float> ray = rays_[gaussian];
        const float depth = ray.at(best.offset.x, best.offset.y);
        shared_.waiting[slot] = listed_as<with_depth>(splat, 0, gaussian, walk_.least_color());
        shared_.waiting_rays[slot] = ray;
        // The most of it lies behind the eye: it comes last.
        passes_ |= bits_of(depth > 0.0f ? depth : kBehindAll) & ~kSlotBits;
      });
      sort_lanes_falling(passes_);
      const std::uint32_t nearer = min(passes_, holds_);
      holds_ = max(passes_, holds_);
      passes_ = nearer;
      sort_lanes_bitonic(passes_);
      sort_lanes_bitonic(holds_);
    }
    passing_ = __popc(__ballot_sync(kAllLanes, has_splat(passes_)));
  }
  static constexpr float kBehindAll = 1e37f;

  Shared& shared_;
  const RayDepth<float>* const rays_;  // (N)
  const PixelRange pixels_;            // of the sub-tile
  const float x_, y_;                  // of this lane's pixel
  Walk walk_;
  WindowKeys held_{};
  // Keys of the warp's sort, one a lane; both rise.
  std::uint32_t passes_ = std::uint32_t(lane_of_thread());
  std::uint32_t holds_ = std::uint32_t(kWarp + lane_of_thread());
  int passing_ = 0;  // splats of passes_, the last ones, that no batch has taken
  bool has_passed_all_ = false, is_done_ = false;
  int quarter_ = 0;
  std::uint32_t counts_ = 0;  // eight bits a quarter
};

}  // namespace gs::cuda
