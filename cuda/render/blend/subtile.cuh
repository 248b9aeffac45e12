// SPDX-License-Identifier: Apache-2.0
// Shared by the blend kernels. A warp owns a sub-tile, 8 x 4 or 8 x 8 pixels of a tile, and walks
// the tile's list on its own. The list tells which 8 x 8 parts of the tile a splat hits. The warp
// fetches 32 splats of its part at a time, tests them against its pixels where these are less than
// a part, and blends them. No warp waits for another one. Sub-tiles of a warp: Yang et al.
// 2026 (warp-level culling); the exact test: Radl et al. 2024.
#pragma once

#include <cuda_pipeline.h>

#include <type_traits>

#include "cuda/device/warp.cuh"
#include "cuda/stages.cuh"
#include "gs_core/math/render/blend.h"
#include "gs_core/math/view/view_splat.h"
#include "gs_render/render_pass.h"

namespace gs::cuda {

// pixels; a row is one sector of memory
inline constexpr int kSubtileWidth = 8, kSubtileHeight = 4;
static_assert(kSubtileWidth * kSubtileHeight == kWarp);
inline constexpr int kSubtilesPerRow = kTileWidth / kSubtileWidth;
inline constexpr int kSubtilesPerTile = kSubtilesPerRow * kTileHeight / kSubtileHeight;

inline constexpr int kBlendThreads = 128;  // four warps: half a tile; they share splats in L1
inline constexpr int kBlendWarps = kBlendThreads / kWarp;
static_assert(kSubtilesPerTile % kBlendWarps == 0);

// Relative slack of the sub-tile's test for rounding: the test must not drop a fragment that the
// pixel's own test keeps. Rounding is worst for needle-like splats, whose terms cancel.
inline constexpr float kSubtileSlack = 4e-6f;

/// A picture and its tiles' lists.
template <class AnySplat>
struct TileListsOf {
  int width, height, tiles_x;
  const std::uint32_t* ranges;  // (tiles + 1)
  const std::uint32_t* splats;  // (I) Gaussian and parts of each place (instance_of)
  const AnySplat* of_gaussian;  // (N)
  float least_color;            // as in RenderPass

  /// The instance at a place before `end`; behind it 0, which hits no part.
  __device__ std::uint32_t instance_at(std::uint32_t place, std::uint32_t end) const {
    return place < end ? splats[place] : 0;
  }
};
using TileLists = TileListsOf<Splat>;

template <class AnySplat>
TileListsOf<AnySplat> tile_lists(const RenderPass& pass, const AnySplat* splats) {
  return {
      pass.width, pass.height,     pass.tiles_x, pass.tile_ranges.data(), pass.tile_splats.data(),
      splats,     pass.least_color};
}
inline TileLists tile_lists(const RenderPass& pass) {
  return tile_lists(pass, static_cast<const Splat*>(pass.splats.data()));
}
/// The tile at a place of the order in which tiles are blended. Without an order it is that of
/// their numbers.
__device__ inline std::uint32_t tile_of(const std::uint32_t* order, std::uint32_t place) {
  return order ? order[place] : place;
}
/// Number of blocks that give each sub-tile of so many tiles, or segments, a warp.
inline std::size_t blend_blocks(std::size_t tiles) {
  return tiles * kSubtilesPerTile / kBlendWarps;
}

/// Calls f(std::bool_constant<value>()).
template <class F>
void with_constant(bool value, F&& f) {
  if (value)
    f(std::true_type());
  else
    f(std::false_type());
}

/// Calls f with the blend rule as a constant.
template <class F>
void with_rule(BlendRule rule, F&& f) {
  if (rule == BlendRule::classic)
    f(std::integral_constant<BlendRule, BlendRule::classic>());
  else
    f(std::integral_constant<BlendRule, BlendRule::faster_gs>());
}

/// The tile, or segment, of this warp, and which of its sub-tiles.
struct WarpWork {
  std::uint32_t item;
  int subtile;

  __device__ WarpWork() {
    const std::uint32_t warp = blockIdx.x * kBlendWarps + threadIdx.x / kWarp;
    item = warp / kSubtilesPerTile;
    subtile = int(warp % kSubtilesPerTile);
  }
};

/// The outermost pixel centers of a sub-tile.
struct PixelRange {
  float x_min, x_max, y_min, y_max;

  __device__ PixelRange(int x0, int y0, int width, int height)
      : x_min(float(x0) + 0.5f), x_max(float(x0 + width) - 0.5f), y_min(float(y0) + 0.5f),
        y_max(float(y0 + height) - 0.5f) {}

  /// The bit of the tile's part that they lie in.
  __device__ std::uint32_t bit() const {
    constexpr int kAcross = kPartsAcross<kTileWidth>;
    return bit_of_part(int(x_min) / kPart % kAcross + int(y_min) / kPart % kAcross * kAcross);
  }
  /// True where a splat may have a fragment among them.
  template <class AnySplat>
  __device__ bool are_hit_by(const AnySplat& splat) const {
    const SplatOutline outline = outline_of(splat);
    return rectangle_is_hit(outline.mean2d, outline.conic, outline.cutoff, x_min, x_max, y_min,
                            y_max, kSubtileSlack);
  }
};

/// The sub-tile of this warp and the pixel of this lane.
struct Subtile {
  std::uint32_t tile;
  int number;      // within the tile, row by row
  int x0, y0;      // upper left pixel
  int x, y;        // this lane's pixel
  bool is_inside;  // the picture

  __device__ Subtile(const TileLists& lists, std::uint32_t tile, int number)
      : tile(tile), number(number) {
    const int lane = lane_of_thread();
    x0 = int(tile) % lists.tiles_x * kTileWidth + number % kSubtilesPerRow * kSubtileWidth;
    y0 = int(tile) / lists.tiles_x * kTileHeight + number / kSubtilesPerRow * kSubtileHeight;
    x = x0 + lane % kSubtileWidth;
    y = y0 + lane / kSubtileWidth;
    is_inside = x < lists.width && y < lists.height;
  }
  __device__ PixelRange pixels() const { return {x0, y0, kSubtileWidth, kSubtileHeight}; }
  __device__ std::size_t pixel(const TileLists& lists) const {
    return std::size_t(y) * lists.width + x;
  }
  /// This lane's place among the pixels of a tile as checkpoints hold them.
  __device__ std::size_t checkpoint(std::uint32_t slot) const {
    return std::size_t(slot) * kTileWidth * kTileHeight + number * kWarp + lane_of_thread();
  }
};

/// The pictures that stage 4 makes, pixel by pixel.
struct Pictures {
  float* image;          // (3, H, W)
  float* transmittance;  // (H, W)
  std::uint32_t* last;   // (H, W) RenderPass::last_instance
  float* depth;          // (H, W)

  explicit Pictures(RenderPass& pass)
      : image(pass.image.data()), transmittance(pass.transmittance.data()),
        last(pass.last_instance.data()), depth(pass.depth_image.data()) {}

  /// Writes this lane's pixel, if it is inside the picture.
  template <bool with_depth>
  __device__ void write(const TileLists& lists, const Subtile& subtile, const Vec3f& background,
                        const PixelState<float>& pixel, std::uint32_t last_instance,
                        float blended_depth) const {
    if (!subtile.is_inside) return;
    const std::size_t to = subtile.pixel(lists), plane = std::size_t(lists.width) * lists.height;
    const Vec3f color = pixel.color + pixel.transmittance * background;
    image[to] = color.x;
    image[plane + to] = color.y;
    image[2 * plane + to] = color.z;
    transmittance[to] = pixel.transmittance;
    last[to] = last_instance;
    if constexpr (with_depth) depth[to] = blended_depth;
  }
};

/// A splat in the form that the pixels of a sub-tile read. Exponents have base 2: e = -|u|^2 with u
/// = L^T d and d = pixel - mean.
struct alignas(16) ListedSplat {
  Vec2f mean2d;
  ConicFactors<float> L;
  float lowest;        // a fragment is kept if and only if e >= lowest
  float opacity, red;  // colors are at least RenderPass::least_color
  float green, blue;
  std::uint32_t position;  // in the tile's list
  std::uint32_t gaussian;
};

__device__ inline ListedSplat listed(const Splat& splat, std::uint32_t position,
                                     std::uint32_t gaussian, float least_color) {
  return {splat.mean2d,
          conic_factors(splat.conic, splat.variance_y),
          -float(kLog2E) * splat.cutoff,
          splat.opacity,
          max_of(splat.color.x, least_color),
          max_of(splat.color.y, least_color),
          max_of(splat.color.z, least_color),
          position,
          gaussian};
}

/// The same with what is summed beside the color.
struct ListedSplatWithDepth : ListedSplat {
  float depth;
};
template <bool with_depth>
using Listed = std::conditional_t<with_depth, ListedSplatWithDepth, ListedSplat>;

template <bool with_depth>
__device__ Listed<with_depth> listed_as(const Splat& splat, std::uint32_t position,
                                        std::uint32_t gaussian, float least_color) {
  if constexpr (with_depth)
    return {listed(splat, position, gaussian, least_color), splat.depth};
  else
    return listed(splat, position, gaussian, least_color);
}

/// The exponent e of a fragment. Forward and backward pass both call this, so that they keep the
/// same fragments.
__device__ inline float base2_exponent(const ListedSplat& splat, float dx, float dy) {
  const float u_x = fmaf(splat.L.xx, dx, splat.L.xy * dy), u_y = splat.L.yy * dy;
  return fmaf(-u_x, u_x, -(u_y * u_y));
}
__device__ inline float exp2_fragment(float e) { return exp2f(e); }

/// A splat for each lane in shared memory. Parts of 16 bytes lie one beside the other, so that the
/// lanes use different banks.
template <class AnySplat>
struct SplatOfLanes {
  static constexpr int kParts = sizeof(AnySplat) / sizeof(float4);
  float4 parts[kParts][kWarp];

  /// Starts to copy this lane's splat, without a register in between.
  __device__ void start_copy(const AnySplat& from) {
    for (int k = 0; k < kParts; ++k)
      __pipeline_memcpy_async(&parts[k][lane_of_thread()],
                              reinterpret_cast<const float4*>(&from) + k, sizeof(float4));
  }
  __device__ AnySplat load() const {
    InVectors<AnySplat> result;
    for (int k = 0; k < kParts; ++k) result.vectors[k] = parts[k][lane_of_thread()];
    return result.value;
  }
};

/// One warp's walk through positions [first, last) of a tile's list, segment by segment and 32
/// places at a time. It finds the splats that hit the warp's pixels, and prefetches the next ones
/// into shared memory.
template <class AnySplat>
class ListWalkOf {
 public:
  using Ahead = SplatOfLanes<AnySplat>;  // prefetched splats: shared memory, one for each warp
  using Lists = TileListsOf<AnySplat>;

  /// `first` is the beginning of a segment. Without `stops_at_segments` the whole range is one
  /// segment.
  __device__ ListWalkOf(Ahead& ahead, const Lists& lists, std::uint32_t tile,
                        const PixelRange& pixels, std::uint32_t first, std::uint32_t last,
                        bool stops_at_segments)
      : splats_(ahead), lists_(lists), pixels_(pixels), part_(pixels.bit()),
        begin_(lists.ranges[tile]), end_(begin_ + last), next_(begin_ + first),
        stop_(stops_at_segments ? min(next_ + kSegmentLength, end_) : end_) {
    instance_ahead_ = lists_.instance_at(next_ + lane_of_thread(), end_);
    fetch();
  }
  __device__ float least_color() const { return lists_.least_color; }
  __device__ bool segment_is_done() const { return next_ >= stop_; }
  __device__ bool is_done() const { return next_ >= end_; }
  /// Goes on to the segment after one that is done, and returns its number.
  __device__ std::uint32_t next_segment() {
    const std::uint32_t number = (next_ - begin_) / kSegmentLength;
    stop_ = min(stop_ + kSegmentLength, end_);
    return number;
  }

  /// The whole warp: finds those of the next 32 splats that hit the pixels, and returns their
  /// number. Calls take(k, splat, position, gaussian) for the k-th of them, each in a lane of its
  /// own.
  template <class Take>
  __device__ int take_next(const Take& take) {
    __pipeline_wait_prior(0);
    const std::uint32_t place = next_ + lane_of_thread(), instance = instance_;
    const AnySplat splat = splats_.load();
    // Both are evaluated: a branch would cost more.
    const bool hit = ((instance & part_) != 0) & pixels_.are_hit_by(splat);
    const unsigned hits = __ballot_sync(kAllLanes, hit);
    next_ += kWarp;
    fetch();
    if (hit) take(__popc(hits & lanes_below()), splat, place - begin_, gaussian_of(instance));
    __syncwarp();
    return __popc(hits);
  }
  /// Walks the list and writes the splats to another list.
  template <class Listed>
  __device__ int list_next(Listed* list) {
    return take_next(
        [&](int k, const Splat& splat, std::uint32_t position, std::uint32_t gaussian) {
          constexpr bool with_depth = std::is_same_v<Listed, ListedSplatWithDepth>;
          list[k] = listed_as<with_depth>(splat, position, gaussian, lists_.least_color);
        });
  }

 private:
  // Starts to copy this lane's splat of the next 32 if it hits the part, and to load the
  // instance after it.
  __device__ void fetch() {
    instance_ = instance_ahead_;
    if (instance_ & part_) splats_.start_copy(lists_.of_gaussian[gaussian_of(instance_)]);
    __pipeline_commit();
    instance_ahead_ = lists_.instance_at(next_ + kWarp + lane_of_thread(), end_);
  }

  Ahead& splats_;  // the next 32
  const Lists& lists_;
  const PixelRange pixels_;
  const std::uint32_t part_;
  std::uint32_t begin_, end_, next_, stop_;  // places in the list
  std::uint32_t instance_ = 0, instance_ahead_ = 0;
};

using ListWalk = ListWalkOf<Splat>;

/// The walk of a warp that owns a part of the tile, of whose edge `edge` is the length, or pixels
/// of it. It fetches only splats that hit the part, 32 at a time. 16 bits are enough for a Position
/// where the walk is no longer than 65,536 places.
template <class AnySplat, int edge, bool with_positions, class Position = std::uint32_t>
class PartWalkOf {
 public:
  using Lists = TileListsOf<AnySplat>;
  /// Shared memory, one for each warp.
  struct Ahead {
    SplatOfLanes<AnySplat> splats;
    // of the splats found, in a ring
    std::uint32_t gaussians[2 * kWarp];
    Position positions[with_positions ? 2 * kWarp : 1];
  };

  /// `part` is its bit.
  __device__ PartWalkOf(Ahead& ahead, const Lists& lists, std::uint32_t tile, std::uint32_t part,
                        std::uint32_t first, std::uint32_t last, bool stops_at_segments)
      : ahead_(ahead), lists_(lists), part_(part), begin_(lists.ranges[tile]), end_(begin_ + last),
        first_(first), next_(begin_ + first),
        stop_(stops_at_segments ? min(next_ + kSegmentLength, end_) : end_) {
    instance_ = lists_.instance_at(next_ + lane_of_thread(), end_);
    instance_after_ = lists_.instance_at(next_ + kWarp + lane_of_thread(), end_);
    look_ahead();
    __syncwarp();
  }
  __device__ float least_color() const { return lists_.least_color; }
  __device__ bool segment_is_done() const { return found_ == 0 && next_ >= stop_; }
  __device__ bool is_done() const { return segment_is_done() && stop_ >= end_; }
  __device__ std::uint32_t next_segment() {
    const std::uint32_t number = (next_ - begin_) / kSegmentLength;
    stop_ = min(stop_ + kSegmentLength, end_);
    look_ahead();
    return number;
  }

  /// The whole warp: takes the next up to 32 splats of the segment as ListWalk does.
  template <class Take>
  __device__ int take_next(const Take& take) {
    __pipeline_wait_prior(0);
    const int lane = lane_of_thread();
    const unsigned count = min(found_, unsigned(kWarp)), place = (taken_ + lane) % (2 * kWarp);
    const AnySplat splat = ahead_.splats.load();
    const std::uint32_t gaussian = ahead_.gaussians[place];
    const std::uint32_t position = with_positions ? position_of(ahead_.positions[place]) : 0;
    taken_ += count;
    found_ -= count;
    if constexpr (with_positions) __syncwarp();  // look_ahead() overwrites positions in the ring
    look_ahead();
    if (lane < count) take(lane, splat, position, gaussian);
    __syncwarp();
    return int(count);
  }

 private:
  // Finds 32 splats, or what is left of the segment, and starts to copy them.
  __device__ void look_ahead() {
    const int lane = lane_of_thread();
    while (found_ < kWarp && next_ < stop_) {
      const bool hit = instance_ & part_;
      const unsigned hits = __ballot_sync(kAllLanes, hit);
      const unsigned place = (taken_ + found_ + __popc(hits & below_)) % (2 * kWarp);
      if (hit) ahead_.gaussians[place] = gaussian_of<edge>(instance_);
      if (with_positions && hit) ahead_.positions[place] = Position(next_ + lane - begin_);
      found_ += __popc(hits);
      next_ += kWarp;
      instance_ = instance_after_;
      instance_after_ = lists_.instance_at(next_ + kWarp + lane, end_);
    }
    __syncwarp();
    if (lane < found_)
      ahead_.splats.start_copy(lists_.of_gaussian[ahead_.gaussians[(taken_ + lane) % (2 * kWarp)]]);
    __pipeline_commit();
  }

  __device__ std::uint32_t position_of(Position stored) const {
    return sizeof(Position) == sizeof(first_) ? stored : first_ + Position(stored - first_);
  }

  Ahead& ahead_;
  const Lists& lists_;
  const std::uint32_t part_;
  const unsigned below_ = lanes_below();
  std::uint32_t begin_, end_;                        // places in the list
  const std::uint32_t first_;                        // position
  std::uint32_t next_, stop_;                        // places in the list
  std::uint32_t instance_ = 0, instance_after_ = 0;  // this lane's, of the next 32 and after
  unsigned taken_ = 0, found_ = 0;                   // splats taken so far, and found beyond those
};

}  // namespace gs::cuda
