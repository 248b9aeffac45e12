// SPDX-License-Identifier: Apache-2.0
// Stage 1 of the operator: one splat per Gaussian, from parameters in any of their forms. It leaves
// what preprocess.cu leaves, so that stages 2 to 4 are those of every other picture.
#include "cuda/operator/given_rows.cuh"
#include "cuda/operator/sh_layout.cuh"
#include "cuda/operator/stages.cuh"
#include "cuda/render/preprocess.cuh"

namespace gs::cuda {
namespace {

template <ShLayout layout>
struct WarpShared {
  GivenShRows<layout> sh;
  TileRows<> tile_rows;
  std::uint32_t hits[kWarp];  // tiles that each lane's splat hits
};

struct Output {
  Splat* splats;
  ProjectedRows rows;
  int tiles_x, tiles_y;
};

// One Gaussian in the view, without its color.
__device__ ProjectedGaussian<float> project(const OperatorInput& in, const Camera& camera,
                                            const Vec3f& mean, const SplatSettings& settings,
                                            std::size_t i) {
  const Vec3f p = to_camera(camera, mean);
  if (!is_between_planes(depth_of(camera, p), settings)) return {};
  const GivenShape shape = shape_of(in, i);
  if (shape.is_degenerate) return {};
  ProjectedGaussian<float> projected =
      project_ellipsoid(camera, p, shape.sigma, shape.opacity, settings);
  if (projected.is_visible && in.arrays.screen.data) {
    const float* const offset = in.arrays.screen[i];
    projected.splat.mean2d += Vec2f(offset[0], offset[1]);
  }
  return projected;
}

// Blocks of a multiprocessor, for which shared memory has room.
constexpr int kBlocks = 6;

template <ShLayout layout, bool has_lens>
__global__ void __launch_bounds__(kPreprocessThreads, has_lens ? 1 : kBlocks)
    project_kernel(const __grid_constant__ OperatorInput in,
                   const __grid_constant__ SplatSettings settings,
                   const __grid_constant__ Output out) {
  __shared__ WarpShared<layout> shared_of_warps[kPreprocessThreads / kWarp];
  WarpShared<layout>& shared = shared_of_warps[threadIdx.x / kWarp];
  const int lane = lane_of_thread();
  const std::size_t i = std::size_t(blockIdx.x) * kPreprocessThreads + threadIdx.x,
                    first = i - lane;
  if (first >= in.count) return;  // the whole warp
  const Camera camera = camera_of<has_lens>(in);
  ProjectedGaussian<float> projected;
  Rect pixels{0, 0, 0, 0};
  Vec3f mean(0.0f);
  if (i < in.count) {
    mean = vector_at(in.arrays.means[i]);
    projected = project(in, camera, mean, settings, i);
    if (projected.is_visible)
      pixels = pixels_of(settings.bounds, projected.splat.mean2d, projected.cov2d,
                         projected.splat.cutoff, out.tiles_x, out.tiles_y);
  }
  Splat& splat = projected.splat;
  std::uint32_t hits = 0;
  if (const SomeRows visible{__ballot_sync(kAllLanes, !pixels.empty())}; visible.bits) {
    constexpr bool has_sh = layout != ShLayout::none;
    if constexpr (has_sh)
      shared.sh.start(in.arrays, first, int(min(in.count - first, std::size_t(kWarp))),
                      settings.sh_degree, visible);
    hits = count_hit_tiles(shared, outline_of(splat), pixels, settings.bounds);
    if constexpr (has_sh) shared.sh.finish(settings.sh_degree);
    if (hits > 0) {
      if constexpr (has_sh)
        splat.color = sh_color(kMaxShDegree, unit_direction(camera.position(), mean),
                               vector_at(in.arrays.sh0[i]), shared.sh.row(lane));
      else
        splat.color = vector_at(in.arrays.colors[i]);
      if (!is_finite(splat.color)) hits = 0;
    }
  }
  if (i >= in.count) return;
  if (hits == 0) return cull(out.rows, i);
  keep(out.rows, i, hits, projected.depth, pixels);
  if (in.has_inverse_depth) splat.depth = 1.0f / projected.depth;
  store_in_vectors(out.splats + i, splat);
}

}  // namespace

void project(Context& context, const OperatorInput& input, const RenderSettings& settings,
             Workspace& workspace, RenderPass& pass) {
  const StageScope scope(context, "project");
  pass.begin(input.camera, input.count);
  pass.scratch<CudaScratch>().has_view_splats = false;
  pass.least_color = least_color(input);
  workspace.depth_keys.resize_discard(input.count);
  const Output out{pass.splats.data(), projected_rows(settings, workspace, pass), pass.tiles_x,
                   pass.tiles_y};
  const SplatSettings& splat_settings = settings;
  with_layout(layout_of(input.arrays, settings.sh_degree), [&](auto layout) {
    const auto kernel =
        input.camera.has_lens() ? project_kernel<layout(), true> : project_kernel<layout(), false>;
    context.launch("project", kernel, blocks_for(input.count, kPreprocessThreads),
                   kPreprocessThreads, input, splat_settings, out);
  });
}

}  // namespace gs::cuda
