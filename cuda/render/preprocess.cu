// SPDX-License-Identifier: Apache-2.0
// Stage 1: one splat per Gaussian; see gs_core/math/render/splat.h for the formulas, and
// spacetime_splat.h for those of Gaussians in space and time. A thread projects one Gaussian. The
// threads of a warp read the parameters of their 32 Gaussians together, in whole cache lines. They
// also share the tile rows of the 32 splats evenly when they count tiles.
// Faster-GS, fused activations, exact and balanced tile culling
#include <algorithm>

#include "cuda/render/preprocess.cuh"
#include "cuda/render/refined_camera.cuh"
#include "cuda/render/sh_rows.cuh"
#include "gs_core/math/spacetime/spacetime_splat.h"

namespace gs::cuda {
namespace {

// The parameters of a warp's 32 Gaussians without SH, as they lie in their arrays.
struct Parameters {
  float mean[3 * kWarp], log_scale[3 * kWarp], sh0[3 * kWarp], rotation[4 * kWarp],
      logit_opacity[kWarp];
  // of Gaussians in space and time
  float right_rotation[4 * kWarp], time_mean[kWarp], log_time_scale[kWarp];
};

struct WarpShared {
  union alignas(16) {                      // for copies of 16 bytes
    Parameters parameters;                 // at first
    float sh_rows[kWarp * kShRowNumbers];  // once the parameters were read; more than they are
  };
  union alignas(16) {
    TileRows<> tile_rows;
    Splat splats[kWarp];  // of ranks, once tiles are counted
  };
  std::uint32_t hits[kWarp];  // tiles that each lane's splat hits
};

// One Gaussian's parameters without SH. Those of time are undefined where it has none.
struct Gaussian {
  Vec3f mean, log_scale, sh0;
  Quatf rotation;
  float logit_opacity;
  Quatf right_rotation;
  float time_mean, log_time_scale;
  float filter_scale;  // 0 without a filter
};

__device__ Quatf quaternion_of(const float* rows, int lane) {
  const float4 q = reinterpret_cast<const float4*>(rows)[lane];
  return {q.x, q.y, q.z, q.w};
}

// The whole warp: loads its Gaussians, all numbers at once, so that it waits for memory only once.
template <bool has_time>
__device__ Gaussian load_gaussian(Parameters& shared, const GaussiansSpan& gaussians,
                                  std::size_t first, int rows) {
  start_copy<3>(shared.mean, numbers_from(gaussians.mean, first), rows);
  start_copy<3>(shared.log_scale, numbers_from(gaussians.log_scale, first), rows);
  start_copy<3>(shared.sh0, numbers_from(gaussians.sh0, first), rows);
  start_copy<4>(shared.rotation, numbers_from(gaussians.rotation, first), rows);
  start_copy<1>(shared.logit_opacity, numbers_from(gaussians.logit_opacity, first), rows);
  if constexpr (has_time) {
    start_copy<4>(shared.right_rotation, numbers_from(gaussians.right_rotation, first), rows);
    start_copy<1>(shared.time_mean, numbers_from(gaussians.time_mean, first), rows);
    start_copy<1>(shared.log_time_scale, numbers_from(gaussians.log_time_scale, first), rows);
  }
  Gaussian gaussian;
  const int lane = lane_of_thread();
  const float* const filter_scale = gaussians.filter_scale.data;
  gaussian.filter_scale = filter_scale && lane < rows ? filter_scale[first + lane] : 0.0f;
  finish_copies();
  const auto vector = [&](const float* of) {
    return Vec3f(of[3 * lane], of[3 * lane + 1], of[3 * lane + 2]);
  };
  gaussian.mean = vector(shared.mean);
  gaussian.log_scale = vector(shared.log_scale);
  gaussian.sh0 = vector(shared.sh0);
  gaussian.rotation = quaternion_of(shared.rotation, lane);
  gaussian.logit_opacity = shared.logit_opacity[lane];
  if constexpr (has_time) {
    gaussian.right_rotation = quaternion_of(shared.right_rotation, lane);
    gaussian.time_mean = shared.time_mean[lane];
    gaussian.log_time_scale = shared.log_time_scale[lane];
  }
  __syncwarp();
  return gaussian;
}

// Whether row i is far from its own time at this moment.
__device__ bool is_row_far_in_time(const GaussiansSpan& gaussians, std::size_t i, float time) {
  return is_far_in_time(gaussians.log_scale[i], gaussians.time_mean[i], gaussians.log_time_scale[i],
                        time);
}

// One Gaussian in the view. Where it is visible and has a time, its mean becomes that of the
// moment.
template <bool has_time>
__device__ ProjectedGaussian<float> project(const Camera& camera, Gaussian& gaussian,
                                            const SplatSettings& settings) {
  if constexpr (has_time) {
    const SpacetimeShape<float> shape{
        gaussian.mean,          gaussian.log_scale, {gaussian.rotation, gaussian.right_rotation},
        gaussian.logit_opacity, gaussian.time_mean, gaussian.log_time_scale};
    const ProjectedMoment<float> moment = project_shape(camera, shape, camera.time, settings);
    gaussian.mean = moment.mean;
    return moment.projected;
  } else {
    return project_shape(camera, gaussian.mean, gaussian.log_scale, gaussian.rotation,
                         gaussian.logit_opacity, gaussian.filter_scale, settings);
  }
}

// What the kernel writes, one row per Gaussian.
struct Output {
  Splat* splats;
  ProjectedRows rows;
};

// The whole warp: writes the splats of the lanes that have one, from row `first` on, in whole
// lines. They may go to another GPU, and vectors of single lanes would use the link badly.
__device__ void store_in_lines(Splat* shared, Splat* first, const Splat& splat, bool has_one) {
  constexpr int kInRow = sizeof(Splat) / sizeof(float4);
  const SomeRows kept{__ballot_sync(kAllLanes, has_one)};
  __syncwarp();  // all have read what was there
  if (has_one) store_in_vectors(shared + lane_of_thread(), splat);
  __syncwarp();
  for (int item = lane_of_thread(); item < kWarp * kInRow; item += kWarp)
    if (kept.has(item / kInRow))
      reinterpret_cast<float4*>(first)[item] = reinterpret_cast<const float4*>(shared)[item];
}

// One photo of a step, or a frame.
struct PhotoInput {
  Camera given;
  const DevicePose* pose;  // null: that of the camera
  SplatSettings settings;
  int tiles_x, tiles_y;
  Output out;
};

// Blocks of a multiprocessor, for which shared memory has room. Lenses need more registers than so
// many would leave.
template <bool has_lens>
constexpr int kBlocks = has_lens ? 6 : 7;

template <int degree, bool has_time, bool has_lens>
__global__ void __launch_bounds__(kPreprocessThreads, kBlocks<has_lens>)
    preprocess_kernel(GaussiansSpan gaussians, const __grid_constant__ PhotoInput in, Shard shard) {
  const Camera camera = refined<has_lens>(in.given, in.pose);
  const SplatSettings& settings = in.settings;
  const Output& out = in.out;
  __shared__ WarpShared shared_of_warps[kPreprocessThreads / kWarp];
  auto& shared = shared_of_warps[threadIdx.x / kWarp];
  const std::size_t i = std::size_t(blockIdx.x) * kPreprocessThreads + threadIdx.x;
  const std::size_t count = gaussians.mean.size, first = i - lane_of_thread();
  if (first >= count) return;  // the whole warp
  const int rows = int(min(count - first, std::size_t(kWarp)));
  const std::size_t to = shard.row_of_all(i);  // the row of what is written
  if constexpr (has_time) {
    // The Gaussians of a warp are neighbors in time: where one is far away, most are.
    const bool is_near = i < count && !is_row_far_in_time(gaussians, i, camera.time);
    if (!__any_sync(kAllLanes, is_near)) {
      if (i < count) cull(out.rows, to);
      return;
    }
  }
  Gaussian gaussian = load_gaussian<has_time>(shared.parameters, gaussians, first, rows);

  ProjectedGaussian<float> projected;
  Rect pixels{0, 0, 0, 0};
  if (i < count) {
    projected = project<has_time>(camera, gaussian, settings);
    if (projected.is_visible)
      pixels = pixels_of(settings.bounds, projected.splat.mean2d, projected.cov2d,
                         projected.splat.cutoff, in.tiles_x, in.tiles_y);
  }
  Splat& splat = projected.splat;
  std::uint32_t hits = 0;
  if (const SomeRows visible{__ballot_sync(kAllLanes, !pixels.empty())}; visible.bits) {
    // The Gaussians of a warp are neighbors in space: where one is visible, most are. In space and
    // time many are not.
    const float* const sh_rest = numbers_from(gaussians.sh_rest, first);
    if constexpr (has_time)
      start_sh_copy<degree>(shared.sh_rows, sh_rest, rows, visible);
    else
      start_sh_copy<degree>(shared.sh_rows, sh_rest, rows);
    hits = count_hit_tiles(shared, outline_of(splat), pixels, settings.bounds);
    finish_copies();
    if (hits > 0) {
      splat.color = sh_color(
          degree, unit_direction(camera.position(), gaussian.mean), gaussian.sh0,
          reinterpret_cast<const Vec3f*>(shared.sh_rows + lane_of_thread() * kShRowNumbers));
      if (!is_finite(splat.color)) hits = 0;
    }
  }
  if (shard.gpus > 1)
    store_in_lines(shared.splats, out.splats + (to - lane_of_thread()), splat, hits > 0);
  if (i >= count) return;
  if (hits == 0) return cull(out.rows, to);
  keep(out.rows, to, hits, projected.depth, pixels);
  if (shard.gpus == 1) store_in_vectors(out.splats + to, splat);
}

// The photos of a batch.
struct BatchInput {
  int photos;
  PhotoInput of[kMostBatch];
};

// Stage 1 for several photos: parameters are read once for all of them.
template <int degree, bool has_time, bool has_lens>
__global__ void __launch_bounds__(kPreprocessThreads, has_lens                              ? 4
                                                      : degree == kMaxShDegree && !has_time ? 6
                                                                                            : 5)
    preprocess_batch_kernel(GaussiansSpan gaussians, const __grid_constant__ BatchInput in,
                            Shard shard) {
  __shared__ WarpShared shared_of_warps[kPreprocessThreads / kWarp];
  auto& shared = shared_of_warps[threadIdx.x / kWarp];
  const int lane = lane_of_thread();
  const std::size_t i = std::size_t(blockIdx.x) * kPreprocessThreads + threadIdx.x;
  const std::size_t count = gaussians.mean.size, first = i - lane;
  if (first >= count) return;  // the whole warp
  const int rows = int(min(count - first, std::size_t(kWarp)));
  const std::size_t to = shard.row_of_all(i);
  unsigned near = (1u << in.photos) - 1;  // photos in whose time a row of the warp is; a bit each
  if constexpr (has_time)
    for (int p = 0; p < in.photos; ++p) {
      const bool is_near = i < count && !is_row_far_in_time(gaussians, i, in.of[p].given.time);
      if (!__any_sync(kAllLanes, is_near)) near &= ~(1u << p);
    }
  Gaussian gaussian;
  if (near) gaussian = load_gaussian<has_time>(shared.parameters, gaussians, first, rows);
  std::uint32_t has_sh = 0;  // rows whose SH is in shared memory
#pragma unroll 1
  for (int p = 0; p < in.photos; ++p) {
    const PhotoInput& photo = in.of[p];
    if (!(near >> p & 1)) {
      if (i < count) cull(photo.out.rows, to);
      continue;
    }
    Gaussian now = gaussian;
    ProjectedGaussian<float> projected;
    Rect pixels{0, 0, 0, 0};
    if (i < count) {
      projected =
          project<has_time>(refined<has_lens>(photo.given, photo.pose), now, photo.settings);
      if (projected.is_visible)
        pixels = pixels_of(photo.settings.bounds, projected.splat.mean2d, projected.cov2d,
                           projected.splat.cutoff, photo.tiles_x, photo.tiles_y);
    }
    Splat& splat = projected.splat;
    std::uint32_t hits = 0;
    if (const std::uint32_t visible = __ballot_sync(kAllLanes, !pixels.empty())) {
      const std::uint32_t missing = (has_time ? visible : kAllLanes) & ~has_sh;
      const float* const sh_rest = numbers_from(gaussians.sh_rest, first);
      if constexpr (has_time)
        start_sh_copy<degree>(shared.sh_rows, sh_rest, rows, SomeRows{missing});
      else if (missing)
        start_sh_copy<degree>(shared.sh_rows, sh_rest, rows);
      hits = count_hit_tiles(shared, outline_of(splat), pixels, photo.settings.bounds);
      if (missing) finish_copies();
      has_sh |= missing;
      if (hits > 0) {
        // Read again, so that the camera takes no registers in between.
        const Vec3f position = refined<has_lens>(photo.given, photo.pose).position();
        const Vec3f direction = unit_direction(position, now.mean);
        const auto* const row =
            reinterpret_cast<const Vec3f*>(shared.sh_rows + lane * kShRowNumbers);
        // SH may rise by a degree between two photos of a batch.
        if (photo.settings.sh_degree == degree)
          splat.color = sh_color(degree, direction, gaussian.sh0, row);
        else
          splat.color = sh_color(photo.settings.sh_degree, direction, gaussian.sh0, row);
        if (!is_finite(splat.color)) hits = 0;
      }
    }
    if (shard.gpus > 1)
      store_in_lines(shared.splats, photo.out.splats + (to - lane), splat, hits > 0);
    if (hits > 0) {
      keep(photo.out.rows, to, hits, projected.depth, pixels);
      if (shard.gpus == 1) store_in_vectors(photo.out.splats + to, splat);
    } else if (i < count) {
      cull(photo.out.rows, to);
    }
    __syncwarp();  // before the next photo takes the shared memory
  }
}

PhotoInput input_of(const PhotoRows& photo) {
  const RenderSettings& settings = photo.settings;
  return {photo.camera,
          photo.pose,
          settings,
          (photo.camera.width + kTileWidth - 1) / kTileWidth,
          (photo.camera.height + kTileHeight - 1) / kTileHeight,
          {photo.splats,
           {photo.depth_keys, photo.pixel_rects, photo.tile_counts,
            depth_keys(settings.near_plane, settings.far_plane)}}};
}

}  // namespace

void preprocess(Context& context, const GaussiansSpan& gaussians, Span<const PhotoRows> photos,
                const Shard& shard) {
  const StageScope scope(context, "preprocess");
  GS_CHECK(photos.size >= 1 && photos.size <= std::size_t(kMostBatch));
  BatchInput in{int(photos.size), {}};
  for (std::size_t p = 0; p < photos.size; ++p) in.of[p] = input_of(photos[p]);
  const std::size_t blocks = blocks_for(gaussians.mean.size, kPreprocessThreads);
  const auto launch = [&](auto kernel, const auto& input) {
    context.launch("preprocess", kernel, blocks, kPreprocessThreads, gaussians, input, shard);
  };
  with_form(photos[photos.size - 1].settings.sh_degree, gaussians, any_has_lens(photos),
            [&](auto degree, auto time, auto lens) {
              if (in.photos == 1)
                launch(preprocess_kernel<degree(), time(), lens()>, in.of[0]);
              else
                launch(preprocess_batch_kernel<degree(), time(), lens()>, in);
            });
}

void preprocess(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, Workspace& workspace, RenderPass& pass) {
  pass.begin(camera, gaussians.mean.size);
  pass.scratch<CudaScratch>().has_view_splats = false;
  workspace.depth_keys.resize_discard(gaussians.mean.size);
  const PhotoRows photo(camera, settings, nullptr, workspace, pass);
  preprocess(context, gaussians, {&photo, 1});
}

}  // namespace gs::cuda
