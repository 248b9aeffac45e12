// SPDX-License-Identifier: Apache-2.0
// How a warp walks a tile's list in the order by pixel, for the blending kernel and its backward
// pass. Each lane has a pixel of the sub-tile. The list is sorted by the depths at each splat's best
// point of the tile (render/pixel_order.cu); from there on each pixel keeps a window of its own
// (pixel_window.h), so that lanes blend different splats at the same time.
#pragma once

#include "cuda/render/blend/pixel_window.h"
#include "cuda/render/blend/subtile.cuh"

namespace gs::cuda {

static_assert(kWindow == kWarp);

/// One warp a block: shared memory allows few warps on a multiprocessor, and they share nothing.
inline constexpr int kPixelOrderThreads = kWarp;
inline std::size_t pixel_order_blocks(std::size_t tiles) { return tiles * kSubtilesPerTile; }

template <bool with_depth>
class PixelOrderWalk {
  using Walk = PartWalkOf<Splat, kTileWidth, false>;

 public:
  using Listed = gs::cuda::Listed<with_depth>;
  /// Of one warp.
  struct Shared {
    Listed listed[kPlaces];                  // splats that pixels wait with
    RayDepth<float> rays[kWindow];           // of those that arrive
    std::uint8_t going[2 * kWindow][kWarp];  // places of the fragments that each pixel blends next
    typename Walk::Ahead ahead;
  };

  __device__ PixelOrderWalk(Shared& shared, const TileLists& lists, const RayDepth<float>* rays,
                            const Subtile& subtile)
      : shared_(shared), rays_(rays), x_(float(subtile.x) + 0.5f), y_(float(subtile.y) + 0.5f),
        walk_(shared.ahead, lists, subtile.tile, subtile.pixels().bit(), 0,
              lists.ranges[subtile.tile + 1] - lists.ranges[subtile.tile], false) {}

  /// Nothing is left: pixels have blended all, or none of them was open.
  __device__ bool is_done() const { return is_done_; }
  /// The third of the places that the next splats take; nobody waits with those that are there.
  __device__ int next_third() const { return third_; }
  /// The splats of a third.
  __device__ int listed_in(int third) const { return int(counts_ >> 8 * third & 255u); }

  /// The whole warp: takes the next splats. Calls keep(place, splat, exponent, is_kept) for each of
  /// them, in order; one is not kept where this lane's pixel has no fragment or is not open. Then
  /// calls blend(place, splat) for fragments of this lane's pixel in their order; after the last
  /// splats, and where no pixel is open, for all that are left.
  template <class Keep, class Blend>
  __device__ void take(bool is_open, const Keep& keep, const Blend& blend) {
    const int first = third_ * kWindow, lane = lane_of_thread();
    const bool any_open = __any_sync(kAllLanes, is_open);
    int count = 0;
    if (any_open)
      count =
          walk_.take_next([&](int k, const Splat& splat, std::uint32_t, std::uint32_t gaussian) {
            shared_.listed[first + k] =
                listed_as<with_depth>(splat, 0, gaussian, walk_.least_color());
            shared_.rays[k] = rays_[gaussian];
          });
    is_done_ = !any_open || walk_.is_done();
    counts_ = (counts_ & ~(255u << 8 * third_)) | std::uint32_t(count) << 8 * third_;
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
    third_ = (third_ + 1) % 3;
    const int going_of_held = is_done_ ? kWindow : count_up_to_third(held_, third_);
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
  Shared& shared_;
  const RayDepth<float>* const rays_;  // (N)
  const float x_, y_;                  // of this lane's pixel
  Walk walk_;
  WindowKeys held_{};
  int third_ = 0;
  bool is_done_ = false;
  std::uint32_t counts_ = 0;  // eight bits a third
};

}  // namespace gs::cuda
