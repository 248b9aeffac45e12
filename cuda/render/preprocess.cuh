// SPDX-License-Identifier: Apache-2.0
// Shared by the kernels of stage 1: what they leave of each Gaussian besides its splat, and how a
// warp counts the tiles that its 32 splats hit.
#pragma once

#include <cuda_pipeline.h>

#include "cuda/render/row_spans.cuh"
#include "cuda/stages.cuh"
#include "gs_core/math/render/depth_key.h"

namespace gs::cuda {

// four warps; shared memory lets 28 warps run on a multiprocessor
inline constexpr int kPreprocessThreads = 128;

/// The whole warp: waits for the copies that it has started.
__device__ inline void finish_copies() {
  __pipeline_commit();
  __pipeline_wait_prior(0);
  __syncwarp();
}

/// The numbers of an array from row `first` on.
template <class T>
__device__ const float* numbers_from(const Span<T>& array, std::size_t first) {
  return reinterpret_cast<const float*>(array.data + first);
}

/// The whole warp: counts the tiles that each lane's splat hits. `pixels` is empty where a lane has
/// no splat. `hits` has a number for each lane.
template <class WarpShared>
__device__ std::uint32_t count_hit_tiles(WarpShared& shared, const SplatOutline& splat,
                                         const Rect& pixels, TileBounds bounds) {
  const int lane = lane_of_thread();
  shared.hits[lane] = 0;
  const std::uint32_t rows = shared.tile_rows.take(splat, pixels, bounds);
  for (std::uint32_t row = lane; row < rows; row += kWarp) {
    const int owner = owner_of(row, shared.tile_rows.first);
    const TileSpan span = shared.tile_rows.span(row, owner);
    if (span.begin < span.end) atomicAdd(&shared.hits[owner], std::uint32_t(span.end - span.begin));
  }
  __syncwarp();
  return shared.hits[lane];
}

/// What stage 1 writes besides splats, one row per Gaussian.
struct ProjectedRows {
  std::uint32_t* depth_keys;
  Rect* pixel_rects;
  std::uint32_t* tile_counts;
  DepthKeys keys;
};
inline constexpr std::uint32_t kCulledKey = (1u << kDepthKeyBits) - 1;  // sorts behind every depth

inline ProjectedRows projected_rows(const RenderSettings& settings, const Workspace& workspace,
                                    const RenderPass& pass) {
  return {workspace.depth_keys.data(), pass.pixel_rects.data(), pass.tile_counts.data(),
          depth_keys(settings.near_plane, settings.far_plane)};
}

__device__ inline void cull(const ProjectedRows& out, std::size_t i) {
  out.tile_counts[i] = 0;
  out.depth_keys[i] = kCulledKey;
}
__device__ inline void keep(const ProjectedRows& out, std::size_t i, std::uint32_t hits,
                            float depth, const Rect& pixels) {
  out.tile_counts[i] = hits;
  out.depth_keys[i] = depth_key(out.keys, depth);
  out.pixel_rects[i] = pixels;
}

}  // namespace gs::cuda
