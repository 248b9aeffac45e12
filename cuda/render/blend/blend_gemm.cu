// SPDX-License-Identifier: Apache-2.0
// Stage 4 on tensor cores (GEMM-GS). One matrix product computes log2(255 alpha) of 32 splats at
// the pixels of a sub-tile, and a second one adds their colors to the pixels. splat_queue.cuh has
// the right-hand sides of both, gemm_pixels.cuh the pixels.
//
// A warp owns 8 x 8 or 8 x 4 pixels and walks its tile's list as subtile.cuh describes. It blends a
// batch of 32 splats into two rows of the sub-tile at a time:
//
//   exponents  The 16 pixels of two rows are the rows of the product. Its layout (mma.cuh, D) gives
//              each pixel to four lanes: lane 4 g + t has column g of the sub-tile and splats 8 t
//              to 8 t + 7 of the batch.
//   weights    Each lane composites its own eight splats as if they were the first. The four lanes
//              then exchange how much light their splats let through, in two shuffles, and scale
//              their weights by the light that reaches them.
//   colors     The weights already have the layout of the left-hand side of the second product.
//
// Depths, where they are wanted, are summed without a product: each lane adds those of its own
// splats, and the four lanes add up at the end.
//
// Exponents are as exact as in fp32: the monomials of a pixel are exact in fp16, a coefficient is
// the sum of two fp16 numbers (together they fill the 16 columns of one product), and sums are
// fp32. Weights are split into two TF32 parts.
#include "cuda/render/blend/gemm_pixels.cuh"
#include "cuda/render/blend/gemm_variants.cuh"

namespace gs::cuda {
namespace {

struct Output {
  float* image;                            // (3, H, W)
  float* transmittance;                    // (H, W)
  std::uint32_t* last;                     // (H, W)
  const std::uint32_t* first_checkpoints;  // (tiles)
  float* checkpoints;                      // (.., pixels of a tile, 4)
  float* depth;                            // (H, W)
  float* depth_checkpoints;                // (.., pixels of a tile)
};

template <BlendRule rule, bool with_history, bool with_depth, int height, class AnySplat_,
          int edge_ = kTileWidth>
struct Variant : PixelVariant<rule, with_history, with_depth, height> {
  using AnySplat = AnySplat_;
  static constexpr int edge = edge_;  // of a tile
  static_assert(edge == kTileWidth || (height == kPart && !with_history));
  static constexpr int kPerRow = edge / kSubtileWidth, kPerTile = kPerRow * edge / height;
  using Walk = std::conditional_t<height == kPart, PartWalkOf<AnySplat, edge, with_history>,
                                  ListWalkOf<AnySplat>>;

  /// What the walk needs to know of the warp's pixels: sub-tile `number` of the tile, with the
  /// corner (x0, y0).
  __device__ static auto pixels_of_walk(int number, int x0, int y0) {
    if constexpr (Variant::has_part)
      return bit_of_part<edge>(number);
    else
      return PixelRange(x0, y0, kSubtileWidth, height);
  }
};

template <class Kind>
struct WarpShared {
  typename Kind::Queue::Shared queue;
  typename SubtilePixels<Kind>::Shared pixels;
  typename Kind::Walk::Ahead ahead;
};

template <class Kind>
__global__ void __launch_bounds__(kBlendThreads, Kind::blocks)
    blend_gemm_kernel(typename Kind::Walk::Lists lists, std::uint32_t tiles,
                      const std::uint32_t* tile_order, Background background, Output out) {
  constexpr int kPerRow = Kind::kPerRow, kPerTile = Kind::kPerTile;
  __shared__ WarpShared<Kind> shared_of_warps[kBlendWarps];
  WarpShared<Kind>& shared = shared_of_warps[threadIdx.x / kWarp];
  const std::uint32_t warp = blockIdx.x * kBlendWarps + threadIdx.x / kWarp;
  if (kPerTile % kBlendWarps != 0 && warp / kPerTile >= tiles) return;  // of the last block
  const std::uint32_t tile = tile_of(tile_order, warp / kPerTile);
  const int number = int(warp % kPerTile);
  const int x_in_tile = number % kPerRow * kSubtileWidth;
  const int y_in_tile = number / kPerRow * Kind::height;
  const int x0 = int(tile) % lists.tiles_x * Kind::edge + x_in_tile;
  const int y0 = int(tile) / lists.tiles_x * Kind::edge + y_in_tile;
  if (x0 >= lists.width || y0 >= lists.height) return;  // the whole warp

  const std::uint32_t length = lists.ranges[tile + 1] - lists.ranges[tile];
  typename Kind::Walk walk(shared.ahead, lists, tile, Kind::pixels_of_walk(number, x0, y0), 0,
                           length, Kind::with_history);
  SubtilePixels<Kind> pixels(shared.pixels, lists, x0, y0);
  typename Kind::Queue queue(shared.queue,
                             {float(x0) + 0.5f * kSubtileWidth, float(y0) + 0.5f * Kind::height});
  while (pixels.any_open() && (queue.count() > 0 || !walk.is_done())) {
    // A segment begins with an empty queue, so that the pixels then have the result of the list
    // before it.
    if (Kind::with_history && queue.count() == 0 && walk.segment_is_done()) {
      const std::size_t slot = out.first_checkpoints[tile] + walk.next_segment() - 1;
      const float behind = pixels.owner() == 3 ? 1.0f : 0.0f;
      for (int pair = 0; pair < Kind::height / 2; ++pair) {
        const int x = x_in_tile + pixels.column(), y = y_in_tile + 2 * pair;
        const int subtile = y / kSubtileHeight * kPerRow + x / kSubtileWidth;
        const int pixel = subtile * kWarp + y % kSubtileHeight * kSubtileWidth + x % kSubtileWidth;
        float* const to =
            &out.checkpoints[4 * (slot * kTileWidth * kTileHeight + pixel) + pixels.owner()];
        const float2 channel = pixels.channel_of_pair(pair, behind);
        to[0] = channel.x;
        to[4 * kSubtileWidth] = channel.y;
        if constexpr (Kind::with_depth) {
          const float2 depth = pixels.depth_of_pair(pair);
          float* const depths = out.depth_checkpoints + slot * kTileWidth * kTileHeight + pixel;
          if (pixels.owner() == 0) depths[0] = depth.x, depths[kSubtileWidth] = depth.y;
        }
      }
    }
    queue.take_batch(walk);
    if (queue.count() > 0) blend_next(queue, pixels);
  }

  // Each lane writes one plane: red, green, blue, or transmittance.
  const int x = x0 + pixels.column(), channel = pixels.owner();
  const std::size_t plane = std::size_t(lists.width) * lists.height;
  const std::size_t first = std::size_t(y0) * lists.width + x;
  float* to = (channel == 3 ? out.transmittance : out.image + channel * plane) + first;
  const Vec3f color = background();
  const float behind = channel == 0   ? color.x
                       : channel == 1 ? color.y
                       : channel == 2 ? color.z
                                      : 1.0f;
  const int rows = x < lists.width ? lists.height - y0 : 0;  // inside the picture
#pragma unroll
  for (int row = 0; row < Kind::height; row += 2) {
    const float2 pair = pixels.channel_of_pair(row / 2, behind);
    if (row < rows) to[0] = pair.x;
    if (row + 1 < rows) to[lists.width] = pair.y;
    to += 2 * lists.width;
  }
  if constexpr (Kind::with_depth) {
    float* at = out.depth + first;
    for (int row = 0; row < Kind::height; row += 2, at += 2 * lists.width) {
      const float2 depth = pixels.depth_of_pair(row / 2);
      if (row < rows && channel == 0) at[0] = depth.x;
      if (row + 1 < rows && channel == 0) at[lists.width] = depth.y;
    }
  }
  if constexpr (Kind::with_history) {
    std::uint32_t* at = out.last + first;
    for (int row = 0; row < Kind::height; ++row, at += lists.width) {
      const std::uint32_t last = pixels.last(row);
      if (row < rows && channel == 3) *at = last;
    }
  }
}

// Below, longer lists cost as much as fewer instances save.
constexpr std::size_t kWidePicture = 1'500'000;  // pixels

}  // namespace

int tile_edge_of(const Context& context, const RenderSettings& settings, const Camera& camera,
                 std::size_t gaussians) {
  const std::size_t pixels = std::size_t(camera.width) * camera.height;
  // The squares of TileBounds::square end with their tiles.
  const bool is_wide = blends_on_tensor_cores(context, settings) && !settings.for_backward &&
                       settings.bounds != TileBounds::square &&
                       gaussians <= kMostListed<kWideTile> && pixels >= kWidePicture &&
                       !has_small_subtiles(context, pixels);
  return is_wide ? kWideTile : kTileWidth;
}

void blend_gemm(Context& context, const RenderSettings& settings, RenderPass& pass) {
  const CudaScratch& scratch = pass.scratch<CudaScratch>();
  const Output out{pass.image.data(),
                   pass.transmittance.data(),
                   pass.last_instance.data(),
                   scratch.first_checkpoints.data(),
                   reinterpret_cast<float*>(scratch.checkpoints()),
                   pass.depth_image.data(),
                   scratch.depth_checkpoints.data()};
  const auto launch = [&](auto kind, const auto* splats) {
    using Kind = decltype(kind);
    context.launch("blend", blend_gemm_kernel<Kind>,
                   blocks_for(pass.tile_count() * Kind::kPerTile, kBlendWarps), kBlendThreads,
                   tile_lists(pass, splats), std::uint32_t(pass.tile_count()), scratch.order(),
                   Background(settings), out);
  };
  if (pass.tile_edge == kWideTile)
    return with_rule(settings.blend_rule, [&](auto rule) {
      launch(Variant<rule(), false, false, kPart, ViewSplat, kWideTile>(),
             static_cast<const ViewSplat*>(scratch.view_splats.data()));
    });
  with_constant(has_small_subtiles(context, pass.pixel_count()), [&](auto small) {
    constexpr int height = small() ? 4 : 8;
    const Splat* const all = pass.splats.data();
    with_rule(settings.blend_rule, [&](auto rule) {
      if (settings.blends_depth)
        return with_constant(settings.for_backward, [&](auto history) {
          launch(Variant<rule(), history(), true, height, Splat>(), all);
        });
      if (settings.for_backward) return launch(Variant<rule(), true, false, height, Splat>(), all);
      with_splats(pass, [&](const auto* splats) {
        using AnySplat = std::remove_cvref_t<decltype(*splats)>;
        launch(Variant<rule(), false, false, height, AnySplat>(), splats);
      });
    });
  });
}

}  // namespace gs::cuda
