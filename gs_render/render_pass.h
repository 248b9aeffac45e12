// SPDX-License-Identifier: Apache-2.0
// What goes into a render and what each stage leaves behind, in stage order. Both backends fill the same
// fields, so that a parity test can compare them after every stage.
#pragma once

#include "gs_core/buffer.h"
#include "gs_core/error.h"
#include "gs_core/math/blend.h"
#include "gs_core/math/splat.h"

namespace gs {

/// How to render: a value, given with each call; there is no hidden global.
struct RenderSettings : SplatSettings {
  Vec3f background{0, 0, 0};                   // sRGB 0..1
  BlendRule blend_rule = BlendRule::faster_gs;
  bool absolute_gradient = false;  // backward's dL_dmean2d sums absolute values over pixels (Ye et al. 2024, AbsGS)
  // How the CUDA backend blends; the scalar one does not ask.
  bool use_tensor_cores = true;   // where the GPU has them: exponents as matrix products, blend_gemm.cu
  bool half_precision = false;    // with them: weights of 11 bits, for viewing
  bool for_backward = true;       // false: what only the backward pass reads may be left out
  bool deterministic = false;     // sums that do not depend on their order, so that a step has one result
};

/// What a place of a tile's list holds: a Gaussian and, for the GPU's sub-tiles, which quarters of the tile its splat hits
/// (hit_quarters_of_row); the scalar backend has the Gaussian alone.
inline constexpr int kGaussianBits = 28;
inline constexpr std::uint32_t kMostGaussians = 1u << kGaussianBits;  // a GPU with room for so many is not built yet
GS_HD std::uint32_t instance_of(std::uint32_t gaussian, unsigned quarters) {
  return gaussian | quarters << kGaussianBits;
}
GS_HD std::uint32_t gaussian_of(std::uint32_t instance) { return instance & (kMostGaussians - 1); }
GS_HD std::uint32_t bit_of_quarter(int quarter) { return 1u << (kGaussianBits + quarter); }

/// A piece of a tile's list.
struct ListSegment {
  std::uint32_t tile;    // kNoTile: none
  std::uint32_t number;  // within the list: 0, 1, ...
};
inline constexpr std::uint32_t kNoTile = 0xffffffffu;

/// Every stage's output. Filled by forward, consumed by backward; reused from step to step, so that
/// steady work allocates nothing.
struct RenderPass {
  int width = 0, height = 0;            // pixels
  int tiles_x = 0, tiles_y = 0;
  Vec3f background{0, 0, 0};            // that the image was blended over

  // 1 preprocess                       one row per Gaussian; rows of culled ones are undefined, all but tile_counts
  Buffer<Splat> splats;                 // (N)
  Buffer<float> depths;                 // (N)   world units along the viewing axis
  Buffer<Rect> pixel_rects;             // (N)   pixels of the bounding rectangle
  Buffer<std::uint32_t> tile_counts;    // (N)   tiles hit; 0 = culled

  // 2 depth order and instances        V visible Gaussians, I instances
  Buffer<std::uint32_t> depth_order;    // (V)   visible Gaussians, near to far, equal depths by index
  Buffer<std::uint32_t> first_instance; // (N)   where a visible Gaussian's instances begin; it has tile_counts
  Buffer<std::uint32_t> instance_tiles; // (I)   tile of each instance, in depth order of its Gaussian
  Buffer<std::uint32_t> instance_splats;  // (I)   its Gaussian

  Buffer<std::uint32_t> sort_scratch;   // (V)   working room of the depth sort, scalar backend

  // 3 tile order                       each tile's instances, front to back
  Buffer<std::uint32_t> tile_splats;    // (I)   their Gaussians (gaussian_of), sorted by tile, stable
  Buffer<std::uint32_t> tile_instances; // (I)   their numbers, scalar backend
  Buffer<std::uint32_t> tile_ranges;    // (tiles+1) tile t owns tile_splats[ranges[t] .. ranges[t+1])
  // for blending on the GPU: what is done first, and lists in segments that can be walked back by themselves
  Buffer<std::uint32_t> tile_order;     // (tiles) those with the longest lists first
  Buffer<std::uint32_t> first_checkpoints;  // (tiles) where a tile's checkpoints begin; one per segment but the first
  Buffer<ListSegment> segments;         // (room for S) the longest first, then empty ones
  Buffer<Vec4f> checkpoints;            // (room for S - tiles, pixels of a tile) color and transmittance before a segment

  // 4 blend
  Buffer<float> image;                  // (3, H, W) with background, not clamped
  Buffer<float> transmittance;          // (H, W)    what is left for the background
  Buffer<std::uint32_t> last_instance;  // (H, W)    1 + position in its tile's list of the last blended; 0 = none

  // 6 blend backward
  Buffer<SplatGradient> instance_gradients;  // (I) each instance's share, summed per splat in a fixed order; scalar backend
  Buffer<Vec2f> absolute_gradients;          // (I) by the mean, absolute values; scalar backend, with absolute_gradient

  explicit RenderPass(Memory& memory = host_memory())
      : splats(memory), depths(memory), pixel_rects(memory), tile_counts(memory),
        depth_order(memory), first_instance(memory), instance_tiles(memory),
        instance_splats(memory), sort_scratch(memory), tile_splats(memory), tile_instances(memory),
        tile_ranges(memory), tile_order(memory), first_checkpoints(memory), segments(memory),
        checkpoints(memory), image(memory), transmittance(memory), last_instance(memory),
        instance_gradients(memory), absolute_gradients(memory) {}

  /// Sizes what stage 1 fills, for a view and so many Gaussians.
  void begin(const Camera& camera, std::size_t gaussians) {
    GS_CHECK(camera.width > 0 && camera.width <= kMaxPictureSide && camera.height > 0 &&
             camera.height <= kMaxPictureSide);
    width = camera.width;
    height = camera.height;
    tiles_x = (camera.width + kTileWidth - 1) / kTileWidth;
    tiles_y = (camera.height + kTileHeight - 1) / kTileHeight;
    splats.resize_discard(gaussians);
    depths.resize_discard(gaussians);
    pixel_rects.resize_discard(gaussians);
    tile_counts.resize_discard(gaussians);
  }

  std::size_t pixel_count() const { return std::size_t(width) * height; }
  std::size_t tile_count() const { return std::size_t(tiles_x) * tiles_y; }
};

}  // namespace gs
