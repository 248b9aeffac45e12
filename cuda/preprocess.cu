// SPDX-License-Identifier: Apache-2.0
// Stage 1: one splat per Gaussian; see gs_core/math/splat.h for the formulas. A thread projects one Gaussian; the
// candidate tiles of a warp's 32 splats are tested by all its lanes together, whoever they belong to, and the SH
// rows of its visible Gaussians are read together.   Faster-GS, fused activations, exact tile culling
#include <algorithm>

#include "cuda/sh_rows.cuh"
#include "cuda/stages.cuh"
#include "cuda/tile_mask.cuh"
#include "gs_core/math/splat.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 128;  // four warps, each with its own room: 28 warps fit a multiprocessor's shared memory

// The candidate tiles of a warp's splats, numbered through.
struct CandidateTiles {
  Vec2f mean2d[kWarp];
  Sym2<float> conic[kWarp];
  float cutoff[kWarp];
  Rect tiles[kWarp];
  std::uint32_t first[kWarp];       // number of the splat's first candidate
  std::uint32_t hits[kWarp];
  unsigned long long mask[kWarp];   // of the first 64 candidates
};

struct WarpRoom {
  CandidateTiles candidates;
  std::uint8_t lane_of_row[kWarp];      // the visible lanes
  float sh_rows[kWarp * kShRowNumbers];  // their SH rows
};

struct TileHits {
  std::uint32_t count;
  std::uint64_t mask;
};

// The whole warp: which tiles each lane's splat hits. `pixels` is empty where a lane has no splat.
__device__ TileHits hit_tiles(CandidateTiles& room, const Splat& splat, const Rect& pixels) {
  const int lane = lane_of_thread();
  const Rect tiles = tile_rect(pixels);
  const std::uint32_t area = pixels.empty() ? 0 : tile_area(tiles);
  const std::uint32_t first = warp_exclusive_sum(area);
  room.mean2d[lane] = splat.mean2d;
  room.conic[lane] = splat.conic;
  room.cutoff[lane] = splat.cutoff;
  room.tiles[lane] = tiles;
  room.first[lane] = first;
  room.hits[lane] = 0;
  room.mask[lane] = 0;
  const std::uint32_t total = __shfl_sync(kAllLanes, first + area, kWarp - 1);
  __syncwarp();
  for (std::uint32_t candidate = lane; candidate < total; candidate += kWarp) {
    const int owner = owner_of(candidate, room.first);
    const std::uint32_t k = candidate - room.first[owner];
    const TilePosition tile = nth_tile(room.tiles[owner], k);
    if (!tile_is_hit(room.mean2d[owner], room.conic[owner], room.cutoff[owner], tile.x, tile.y))
      continue;
    atomicAdd(&room.hits[owner], 1u);
    if (k < kTileMaskBits) atomicOr(&room.mask[owner], 1ull << k);
  }
  __syncwarp();
  return {room.hits[lane], room.mask[lane]};
}

// The whole warp: copies the SH rows of the visible lanes into shared memory, and returns where this lane's
// begins.
template <int degree>
__device__ const float* stage_sh_rows(WarpRoom& room, const ShRest* rows, bool is_visible) {
  if constexpr (degree == 0) return nullptr;
  constexpr int kNumbers = std::max(kShNumbersInUse<degree>, 1);
  const int lane = lane_of_thread();
  const unsigned visible = __ballot_sync(kAllLanes, is_visible);
  const int row = __popc(visible & lanes_below());
  if (is_visible) room.lane_of_row[row] = std::uint8_t(lane);
  __syncwarp();
  const int total = __popc(visible) * kNumbers;
#pragma unroll 9
  for (int k = lane; k < total; k += kWarp) {
    const int from = k / kNumbers, number = k % kNumbers;
    room.sh_rows[from * kShRowNumbers + number] =
        reinterpret_cast<const float*>(rows + room.lane_of_row[from])[number];
  }
  __syncwarp();
  return room.sh_rows + row * kShRowNumbers;
}

// What the kernel writes, one row per Gaussian.
struct Output {
  Splat* splats;
  std::uint32_t* depth_keys;  // the bits of the depth; culled ones sort behind all others
  Rect* pixel_rects;
  std::uint32_t* tile_counts;
  std::uint64_t* tile_masks;
};
constexpr std::uint32_t kCulledDepth = 0xffffffffu;

template <int degree>
__global__ void __launch_bounds__(kThreads)
    preprocess_kernel(GaussiansSpan gaussians, Camera camera, SplatSettings settings, int tiles_x,
                      int tiles_y, Output out) {
  __shared__ WarpRoom rooms[kThreads / kWarp];
  WarpRoom& room = rooms[threadIdx.x / kWarp];
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  const std::size_t first_of_warp = i - lane_of_thread();

  ProjectedGaussian<float> projected;
  Rect pixels{0, 0, 0, 0};
  if (i < gaussians.mean.size) {
    projected = project_shape(camera, gaussians.mean[i], gaussians.log_scale[i],
                              gaussians.rotation[i], gaussians.logit_opacity[i], settings);
    if (projected.is_visible)
      pixels = pixel_rect(projected.splat.mean2d, projected.cov2d, projected.splat.cutoff, tiles_x,
                          tiles_y);
  }
  Splat& splat = projected.splat;
  TileHits hits{0, 0};
  if (__any_sync(kAllLanes, !pixels.empty())) {
    hits = hit_tiles(room.candidates, splat, pixels);
    const bool is_visible = hits.count > 0;
    const float* const row =
        stage_sh_rows<degree>(room, gaussians.sh_rest.data + first_of_warp, is_visible);
    if (is_visible) {
      splat.color = sh_color(degree, unit_direction(camera.position(), gaussians.mean[i]),
                             gaussians.sh0[i], reinterpret_cast<const Vec3f*>(row));
      if (!is_finite(splat.color)) hits.count = 0;
    }
  }
  if (i >= gaussians.mean.size) return;
  out.tile_counts[i] = hits.count;
  out.depth_keys[i] = hits.count ? __float_as_uint(projected.depth) : kCulledDepth;
  if (!hits.count) return;
  store_in_vectors(out.splats + i, splat);
  out.pixel_rects[i] = pixels;
  out.tile_masks[i] = hits.mask;
}

}  // namespace

void preprocess(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, WorkingRoom& room, RenderPass& pass) {
  const StageScope scope(context, "preprocess");
  const std::size_t count = gaussians.mean.size;
  GS_CHECK(camera.width > 0 && camera.width <= kMaxPictureSide && camera.height > 0 &&
           camera.height <= kMaxPictureSide);
  pass.width = camera.width;
  pass.height = camera.height;
  pass.tiles_x = (camera.width + kTileWidth - 1) / kTileWidth;
  pass.tiles_y = (camera.height + kTileHeight - 1) / kTileHeight;
  pass.splats.resize_discard(count);
  pass.depths.resize_discard(count);
  pass.pixel_rects.resize_discard(count);
  pass.tile_counts.resize_discard(count);
  room.tile_masks.resize_discard(count);
  const Output out{pass.splats.data(), reinterpret_cast<std::uint32_t*>(pass.depths.data()),
                   pass.pixel_rects.data(), pass.tile_counts.data(), room.tile_masks.data()};
  with_sh_degree(settings.sh_degree, [&](auto degree) {
    context.launch("preprocess", preprocess_kernel<degree()>, blocks_for(count, kThreads), kThreads,
                   gaussians, camera, settings, pass.tiles_x, pass.tiles_y, out);
  });
}

}  // namespace gs::cuda
