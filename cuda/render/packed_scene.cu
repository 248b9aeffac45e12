// SPDX-License-Identifier: Apache-2.0
// Packs a model for viewing, and preprocesses frames from it: stage 1 as preprocess.cu does it,
// with the same functions, compiled alike, so that splats have the same shapes to the last bit.
#include "cuda/render/packed_scene.cuh"

#include "cuda/render/preprocess.cuh"
#include "cuda/render/sh_rows.cuh"
#include "gs_core/math/view/packed_sh.h"

namespace gs::cuda {
namespace {

constexpr int kThreads = kPreprocessThreads;
static_assert(kThreads == kRowsOfBox);

// ---- Packing, once for each model

__device__ Box3 box_of_warp(Box3 box) {
  for (int distance = kWarp / 2; distance > 0; distance /= 2) {
    Box3 other;
    for (int c = 0; c < 3; ++c) {
      other.low[c] = __shfl_xor_sync(kAllLanes, box.low[c], distance);
      other.high[c] = __shfl_xor_sync(kAllLanes, box.high[c], distance);
    }
    box = joined(box, other);
  }
  return box;
}

__global__ void __launch_bounds__(kThreads)
    pack_ellipsoids_kernel(GaussiansSpan gaussians, Ellipsoid* ellipsoids, Box3* boxes) {
  __shared__ Box3 box_of_warps[kThreads / kWarp];
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  Box3 box = kEmptyBox;
  if (i < gaussians.mean.size) {
    const Vec3f mean = gaussians.mean[i], log_scale = gaussians.log_scale[i];
    const Quatf rotation = gaussians.rotation[i];
    const float logit_opacity = gaussians.logit_opacity[i];
    const float filter_scale = gaussians.has_filter ? gaussians.filter_scale[i] : 0.0f;
    const Ellipsoid ellipsoid =
        ellipsoid_of(mean, log_scale, rotation, logit_opacity, filter_scale);
    ellipsoids[i] = ellipsoid;
    box = box_of(ellipsoid);
  }
  box = box_of_warp(box);
  if (lane_of_thread() == 0) box_of_warps[threadIdx.x / kWarp] = box;
  __syncthreads();
  if (threadIdx.x > 0) return;
  for (int warp = 1; warp < kThreads / kWarp; ++warp) box = joined(box, box_of_warps[warp]);
  boxes[blockIdx.x] = box;
}

// Writes rows of `vectors` vectors of 16 bytes: ColorRows with `numbers` numbers beyond degree 0.
__global__ void __launch_bounds__(kThreads)
    pack_colors_kernel(Span<Vec3f> sh0, Span<ShRest> sh_rest, int numbers, int vectors,
                       float4* colors) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= sh0.size) return;
  float4* const row = colors + i * vectors;
  const float* const rest = &sh_rest[i].coefficient[0].x;
  const float scale = packed_sh_scale(rest, numbers);
  row[0] = {sh0[i].x, sh0[i].y, sh0[i].z, scale};
  auto* const to = reinterpret_cast<std::int16_t*>(row + 1);
  for (int k = 0; k < 8 * (vectors - 1); ++k) to[k] = k < numbers ? packed_sh(rest[k], scale) : 0;
}

// ---- Preprocessing, in each frame

template <class Row, int edge>
struct alignas(16) WarpShared {
  static constexpr int kVectors = sizeof(Row) / sizeof(float4);
  // Vectors from row to row. It is odd, so that lanes that read one row each use different banks.
  static constexpr int kStride = kVectors | 1;
  union {
    Ellipsoid ellipsoids[kWarp];     // at first
    float4 colors[kWarp * kStride];  // once the ellipsoids were read
  };
  TileRows<edge> tile_rows;
  std::uint32_t hits[kWarp];  // tiles that each lane's splat hits
};

// The whole warp: loads its ellipsoids.
__device__ Ellipsoid load_ellipsoid(Ellipsoid* shared, const Ellipsoid* ellipsoids, int rows) {
  constexpr int kNumbers = sizeof(Ellipsoid) / sizeof(float);
  start_copy<kNumbers>(reinterpret_cast<float*>(shared), reinterpret_cast<const float*>(ellipsoids),
                       rows);
  finish_copies();
  float numbers[kNumbers];
  const float2* const from = reinterpret_cast<const float2*>(shared + lane_of_thread());
#pragma unroll
  for (int k = 0; k < kNumbers / 2; ++k) {
    numbers[2 * k] = from[k].x;
    numbers[2 * k + 1] = from[k].y;
  }
  __syncwarp();
  const float* const n = numbers;
  return {{n[0], n[1], n[2]}, {n[3], n[4], n[5], n[6], n[7], n[8]}, n[9]};
}

// The whole warp: starts to copy the colors of some rows.
template <class Shared>
__device__ void start_color_copy(Shared& shared, const float4* colors, int rows, SomeRows mask) {
  constexpr int kVectors = Shared::kVectors;
  for (int k = lane_of_thread(); k < rows * kVectors; k += kWarp) {
    const int row = k / kVectors;
    if (mask.has(row))
      __pipeline_memcpy_async(&shared.colors[row * Shared::kStride + k % kVectors], colors + k,
                              sizeof(float4));
  }
}

// The color of this lane's row.
template <int degree>
__device__ Vec3f color_of(const float4* from, const Vec3f& direction) {
  using Row = ColorRow<degree>;
  union Copy {
    __device__ Copy() {}
    float4 vectors[sizeof(Row) / sizeof(float4)];
    Row row;
  } copy;
#pragma unroll
  for (std::size_t k = 0; k < sizeof(Row) / sizeof(float4); ++k) copy.vectors[k] = from[k];
  const Row& row = copy.row;
  if constexpr (degree == 0)
    return sh_color(0, direction, row.sh0, static_cast<const Vec3f*>(nullptr));
  else
    return packed_sh_color(degree, direction, row.sh0, row.scale, row.rest);
}

// A packed model as the kernel reads it.
struct Input {
  std::size_t count;
  const Ellipsoid* ellipsoids;
  const Box3* boxes;  // null: they do not hold for these settings
  const float4* colors;
  int tiles_x, tiles_y;
};

// The whole warp: true where the view shows nothing of the block's rows. Each lane does one test.
__device__ bool is_block_outside(const Input& in, const Camera& camera,
                                 const SplatSettings& settings) {
  const int test = lane_of_thread();
  const bool is_below =
      test < kBoxTests && box_test(camera, settings, in.boxes[blockIdx.x], test) < 0;
  return is_box_outside(__ballot_sync(kAllLanes, is_below));
}

template <int degree, int edge>
__global__ void __launch_bounds__(kThreads)
    preprocess_packed_kernel(Input in, Camera given, SplatSettings settings, ViewSplat* splats,
                             ProjectedRows out) {
  const Camera camera = refined<false>(given, nullptr);
  using Shared = WarpShared<ColorRow<degree>, edge>;
  __shared__ Shared shared_of_warps[kThreads / kWarp];
  Shared& shared = shared_of_warps[threadIdx.x / kWarp];
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  const std::size_t first = i - lane_of_thread();
  if (first >= in.count) return;  // the whole warp
  if (in.boxes && is_block_outside(in, camera, settings)) {
    if (i < in.count) cull(out, i);
    return;
  }
  const int rows = int(min(in.count - first, std::size_t(kWarp)));
  const Ellipsoid ellipsoid = load_ellipsoid(shared.ellipsoids, in.ellipsoids + first, rows);

  ProjectedGaussian<float> projected;
  Rect pixels{0, 0, 0, 0};
  if (i < in.count) {
    projected = project_shape(camera, ellipsoid, settings);
    if (projected.is_visible)
      pixels = pixels_of<edge>(settings.bounds, projected.splat.mean2d, projected.cov2d,
                               projected.splat.cutoff, in.tiles_x, in.tiles_y);
  }
  ViewSplat splat = view_splat(projected.splat);  // without color
  std::uint32_t hits = 0;
  if (const SomeRows visible{__ballot_sync(kAllLanes, !pixels.empty())}; visible.bits) {
    start_color_copy(shared, in.colors + first * Shared::kVectors, rows, visible);
    hits = count_hit_tiles(shared, outline_of(splat), pixels, settings.bounds);
    finish_copies();
    if (hits > 0) {
      const Vec3f color = color_of<degree>(shared.colors + lane_of_thread() * Shared::kStride,
                                           unit_direction(camera.position(), ellipsoid.mean));
      if (!is_finite(color)) hits = 0;
      splat.color = packed_color(color);
    }
  }
  if (i >= in.count) return;
  if (hits == 0) return cull(out, i);
  keep(out, i, hits, projected.depth, pixels);
  store_in_vectors(splats + i, splat);
}

}  // namespace

CudaPackedScene::CudaPackedScene(Context& context, Memory& memory, const GaussiansSpan& gaussians,
                                 const RenderSettings& settings)
    : PackedScene(gaussians), sh_degree(settings.sh_degree),
      ellipsoids(gaussians.mean.size, memory),
      boxes(blocks_for(gaussians.mean.size, kRowsOfBox), memory), colors(memory) {
  GS_CHECK(!gaussians.has_time);
  const StageScope scope(context, "pack");
  context.launch("pack ellipsoids", pack_ellipsoids_kernel, boxes.size(), kThreads, gaussians,
                 ellipsoids.data(), boxes.data());
  with_sh_degree(sh_degree, [&](auto degree) {
    constexpr int kVectors = sizeof(ColorRow<degree()>) / sizeof(float4);
    colors.resize(count() * kVectors);
    context.launch("pack colors", pack_colors_kernel, boxes.size(), kThreads, gaussians.sh0,
                   gaussians.sh_rest, 3 * sh_rest_count(degree()), kVectors, colors.data());
  });
}

void preprocess(Context& context, const CudaPackedScene& scene, const Camera& camera,
                const RenderSettings& settings, Workspace& workspace, RenderPass& pass) {
  const StageScope scope(context, "preprocess");
  CudaScratch& scratch = pass.scratch<CudaScratch>();
  scratch.has_view_splats = true;
  pass.begin(camera, scene.count(), false, tile_edge_of(context, settings, camera, scene.count()));
  scratch.view_splats.resize_discard(scene.count());
  workspace.depth_keys.resize_discard(scene.count());
  const Input in{scene.count(),
                 scene.ellipsoids.data(),
                 boxes_hold(settings) ? scene.boxes.data() : nullptr,
                 scene.colors.data(),
                 pass.tiles_x,
                 pass.tiles_y};
  with_sh_degree(scene.sh_degree, [&](auto degree) {
    const auto launch = [&](auto kernel) {
      context.launch("preprocess", kernel, blocks_for(scene.count(), kThreads), kThreads, in,
                     camera, settings, scratch.view_splats.data(),
                     projected_rows(settings, workspace, pass));
    };
    if (pass.tile_edge == kWideTile)
      launch(preprocess_packed_kernel<degree(), kWideTile>);
    else
      launch(preprocess_packed_kernel<degree(), kTileWidth>);
  });
}

}  // namespace gs::cuda
