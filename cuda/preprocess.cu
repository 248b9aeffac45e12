// SPDX-License-Identifier: Apache-2.0
// Stage 1: one splat per Gaussian; see gs_core/math/splat.h for the formulas. A thread projects one
// Gaussian. The threads of a warp read the parameters of their 32 Gaussians together, in whole
// cache lines. They also share the tile rows of the 32 splats evenly when they count tiles.
// Faster-GS, fused activations, exact and balanced tile culling
#include <algorithm>

#include "cuda/row_spans.cuh"
#include "cuda/sh_rows.cuh"
#include "cuda/stages.cuh"
#include "gs_core/math/depth_key.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = 128;  // four warps; shared memory lets 28 warps run on a multiprocessor

// The parameters of a warp's 32 Gaussians without SH, as they lie in their arrays.
struct Parameters {
  float mean[3 * kWarp], log_scale[3 * kWarp], sh0[3 * kWarp], rotation[4 * kWarp],
      logit_opacity[kWarp];
};

struct alignas(16) WarpShared {
  union {
    Parameters parameters;                 // at first
    float sh_rows[kWarp * kShRowNumbers];  // once the parameters were read
  };
  TileRows tile_rows;
  std::uint32_t hits[kWarp];  // tiles that each lane's splat hits
};

// The whole warp: waits for the copies that it has started.
__device__ void finish_copies() {
  __pipeline_commit();
  __pipeline_wait_prior(0);
  __syncwarp();
}

// The numbers of an array from row `first` on.
template <class T>
__device__ const float* numbers_from(const Span<T>& array, std::size_t first) {
  return reinterpret_cast<const float*>(array.data + first);
}

// One Gaussian's parameters without SH.
struct Gaussian {
  Vec3f mean, log_scale, sh0;
  Quatf rotation;
  float logit_opacity;
};

// The whole warp: loads its Gaussians, all numbers at once, so that it waits for memory only once.
__device__ Gaussian load_gaussian(Parameters& shared, const GaussiansSpan& gaussians,
                                  std::size_t first, int rows) {
  start_copy<3>(shared.mean, numbers_from(gaussians.mean, first), rows);
  start_copy<3>(shared.log_scale, numbers_from(gaussians.log_scale, first), rows);
  start_copy<3>(shared.sh0, numbers_from(gaussians.sh0, first), rows);
  start_copy<4>(shared.rotation, numbers_from(gaussians.rotation, first), rows);
  start_copy<1>(shared.logit_opacity, numbers_from(gaussians.logit_opacity, first), rows);
  finish_copies();
  const int lane = lane_of_thread();
  const auto vector = [&](const float* of) {
    return Vec3f(of[3 * lane], of[3 * lane + 1], of[3 * lane + 2]);
  };
  const float4 q = reinterpret_cast<const float4*>(shared.rotation)[lane];
  const Gaussian gaussian{vector(shared.mean),
                          vector(shared.log_scale),
                          vector(shared.sh0),
                          {q.x, q.y, q.z, q.w},
                          shared.logit_opacity[lane]};
  __syncwarp();
  return gaussian;
}

// The whole warp: counts the tiles that each lane's splat hits. `pixels` is empty where a lane has
// no splat.
__device__ std::uint32_t count_hit_tiles(WarpShared& shared, const Splat& splat, const Rect& pixels,
                                         TileBounds bounds) {
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
  __shared__ WarpShared shared_of_warps[kThreads / kWarp];
  WarpShared& shared = shared_of_warps[threadIdx.x / kWarp];
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  const std::size_t count = gaussians.mean.size, first = i - lane_of_thread();
  if (first >= count) return;  // the whole warp
  const int rows = int(min(count - first, std::size_t(kWarp)));
  const Gaussian gaussian = load_gaussian(shared.parameters, gaussians, first, rows);

  ProjectedGaussian<float> projected;
  Rect pixels{0, 0, 0, 0};
  if (i < count) {
    projected = project_shape(camera, gaussian.mean, gaussian.log_scale, gaussian.rotation,
                              gaussian.logit_opacity, settings);
    if (projected.is_visible)
      pixels = pixels_of(settings.bounds, projected.splat.mean2d, projected.cov2d,
                         projected.splat.cutoff, tiles_x, tiles_y);
  }
  Splat& splat = projected.splat;
  std::uint32_t hits = 0;
  if (__any_sync(kAllLanes, !pixels.empty())) {
    // The Gaussians of a warp are neighbors in space: where one is visible, most are.
    start_sh_copy<degree>(shared.sh_rows, numbers_from(gaussians.sh_rest, first), rows);
    hits = count_hit_tiles(shared, splat, pixels, settings.bounds);
    finish_copies();
    if (hits > 0) {
      splat.color = sh_color(
          degree, unit_direction(camera.position(), gaussian.mean), gaussian.sh0,
          reinterpret_cast<const Vec3f*>(shared.sh_rows + lane_of_thread() * kShRowNumbers));
      if (!is_finite(splat.color)) hits = 0;
    }
  }
  if (i >= count) return;
  out.tile_counts[i] = hits;
  out.depth_keys[i] = hits ? depth_key(out.keys, projected.depth) : kCulledKey;
  if (!hits) return;
  store_in_vectors(out.splats + i, splat);
  out.depths[i] = projected.depth;
  out.pixel_rects[i] = pixels;
}

}  // namespace

void preprocess(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, Workspace& workspace, RenderPass& pass) {
  const StageScope scope(context, "preprocess");
  const std::size_t count = gaussians.mean.size;
  pass.begin(camera, count);
  workspace.depth_keys.resize_discard(count);
  const Output out{
      pass.splats.data(),          pass.depths.data(),
      workspace.depth_keys.data(), pass.pixel_rects.data(),
      pass.tile_counts.data(),     depth_keys(settings.near_plane, settings.far_plane)};
  with_sh_degree(settings.sh_degree, [&](auto degree) {
    context.launch("preprocess", preprocess_kernel<degree()>, blocks_for(count, kThreads), kThreads,
                   gaussians, camera, settings, pass.tiles_x, pass.tiles_y, out);
  });
}

}  // namespace gs::cuda
