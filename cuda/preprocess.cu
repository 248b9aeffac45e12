// SPDX-License-Identifier: Apache-2.0
// Stage 1: one splat per Gaussian; see gs_core/math/splat.h for the formulas. A thread projects one Gaussian; the tile
// rows of a warp's 32 splats are counted by all its lanes together, whoever they belong to, and the SH rows of its
// visible Gaussians are read together.   Faster-GS, fused activations, exact and balanced tile culling
#include <algorithm>

#include "cuda/row_spans.cuh"
#include "cuda/sh_rows.cuh"
#include "cuda/stages.cuh"
#include "gs_core/math/depth_key.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 128;  // four warps, each with its own room: 28 warps fit a multiprocessor's shared memory

struct WarpRoom {
  TileRows tile_rows;
  std::uint32_t hits[kWarp];            // tiles that each lane's splat hits
  std::uint8_t lane_of_row[kWarp];      // the visible lanes
  float sh_rows[kWarp * kShRowNumbers];  // their SH rows
};

// The whole warp: how many tiles each lane's splat hits. `pixels` is empty where a lane has no splat.
__device__ std::uint32_t count_hit_tiles(WarpRoom& room, const Splat& splat, const Rect& pixels) {
  const int lane = lane_of_thread();
  room.hits[lane] = 0;
  const std::uint32_t rows = room.tile_rows.take(splat, pixels);
  for (std::uint32_t row = lane; row < rows; row += kWarp) {
    const int owner = owner_of(row, room.tile_rows.first);
    const TileSpan span = room.tile_rows.span(row, owner);
    if (span.begin < span.end) atomicAdd(&room.hits[owner], std::uint32_t(span.end - span.begin));
  }
  __syncwarp();
  return room.hits[lane];
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
  float* depths;
  std::uint32_t* depth_keys;
  Rect* pixel_rects;
  std::uint32_t* tile_counts;
  DepthKeys keys;
};
constexpr std::uint32_t kCulledKey = (1u << kDepthKeyBits) - 1;  // sorts behind every depth

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
  std::uint32_t hits = 0;
  if (__any_sync(kAllLanes, !pixels.empty())) {
    hits = count_hit_tiles(room, splat, pixels);
    const float* const row =
        stage_sh_rows<degree>(room, gaussians.sh_rest.data + first_of_warp, hits > 0);
    if (hits > 0) {
      splat.color = sh_color(degree, unit_direction(camera.position(), gaussians.mean[i]),
                             gaussians.sh0[i], reinterpret_cast<const Vec3f*>(row));
      if (!is_finite(splat.color)) hits = 0;
    }
  }
  if (i >= gaussians.mean.size) return;
  out.tile_counts[i] = hits;
  out.depth_keys[i] = hits ? depth_key(out.keys, projected.depth) : kCulledKey;
  if (!hits) return;
  store_in_vectors(out.splats + i, splat);
  out.depths[i] = projected.depth;
  out.pixel_rects[i] = pixels;
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
  room.depth_keys.resize_discard(count);
  const Output out{pass.splats.data(),      pass.depths.data(),
                   room.depth_keys.data(),  pass.pixel_rects.data(),
                   pass.tile_counts.data(), depth_keys(settings.near_plane, settings.far_plane)};
  with_sh_degree(settings.sh_degree, [&](auto degree) {
    context.launch("preprocess", preprocess_kernel<degree()>, blocks_for(count, kThreads), kThreads,
                   gaussians, camera, settings, pass.tiles_x, pass.tiles_y, out);
  });
}

}  // namespace gs::cuda
