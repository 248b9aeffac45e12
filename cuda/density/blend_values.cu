// SPDX-License-Identifier: Apache-2.0
// In a score pass of density control: sums of the values of the pixels over the fragments of each
// Gaussian, twin of gs_render/stages/blend_values.cpp. subtile.cuh describes the work of a warp.
// Sums are in fixed point, so that they do not depend on the order of additions.
#include "cuda/gradients/fragment_sums.cuh"
#include "cuda/render/blend/subtile.cuh"
#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // rows are independent: any size that fills the GPU

struct WarpShared {
  ListedSplat list[kWarp];
  ListWalk::Ahead ahead;
};

// A warp owns a sub-tile and goes through its fragments front to back, a pixel per lane. It sums up
// one splat of the list after another; lane i keeps the sums of the i-th, and adds them to those of
// its Gaussian.
template <BlendRule rule>
__global__ void __launch_bounds__(kBlendThreads)
    sum_values_kernel(TileLists lists, const std::uint32_t* last_instance, const float* values,
                      FixedFragmentSums* sums) {
  __shared__ WarpShared shared_of_warps[kBlendWarps];
  WarpShared& shared = shared_of_warps[threadIdx.x / kWarp];
  const int lane = lane_of_thread();
  const WarpWork work;
  const Subtile subtile(lists, work.item, work.subtile);
  float value = 0, transmittance = 1;
  std::uint32_t last = 0;  // 1 + position of the pixel's last fragment
  if (subtile.is_inside) {
    const std::size_t at = subtile.pixel(lists);
    value = values[at];
    last = last_instance[at];
  }
  const std::uint32_t longest = warp_max(last);
  if (longest == 0) return;  // the whole warp
  const float x = float(subtile.x) + 0.5f, y = float(subtile.y) + 0.5f;
  for (ListWalk walk(shared.ahead, lists, subtile.tile, subtile.pixels(), 0, longest, false);
       !walk.is_done();) {
    const int count = walk.list_next(shared.list);
    FragmentSums of_lane;
    for (int i = 0; i < count; ++i) {
      const ListedSplat splat = shared.list[i];
      const float e = base2_exponent(splat, x - splat.mean2d.x, y - splat.mean2d.y);
      const bool is_kept = e >= splat.lowest && splat.position < last;
      const float alpha = is_kept ? fragment_alpha<rule>(splat.opacity, exp2_fragment(e)) : 0.0f;
      const float weighted = warp_sum(transmittance * alpha * value);
      const float whole = warp_sum(is_kept ? value : 0.0f);
      const unsigned kept = __ballot_sync(kAllLanes, is_kept);
      if (lane == i) of_lane = {float(__popc(kept)), weighted, whole};
      transmittance *= 1.0f - alpha;
    }
    if (lane < count && of_lane.count > 0) add_to(sums[shared.list[lane].gaussian], of_lane);
    __syncwarp();
  }
}

__global__ void collect_kernel(Span<FragmentSums> to, FixedFragmentSums* sums) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= to.size) return;
  add_to(to[i], sums_of(sums[i]));
  sums[i] = {};
}

}  // namespace

void blend_values(Context& context, const RenderSettings& settings, Workspace& workspace,
                  const RenderPass& pass, Span<FragmentSums> to) {
  const StageScope scope(context, "score pass");
  Buffer<FixedFragmentSums>& sums = workspace.fixed_fragment_sums;
  if (sums.size() < to.size) {
    sums.resize_discard(to.size);
    sums.fill_zero();
  }
  with_rule(settings.blend_rule, [&](auto blend_rule) {
    context.launch("score pass", sum_values_kernel<blend_rule()>, blend_blocks(pass.tile_count()),
                   kBlendThreads, tile_lists(pass), pass.last_instance.data(),
                   workspace.pixel_values.data(), sums.data());
  });
  context.launch("score pass", collect_kernel, blocks_for(to.size, kThreads), kThreads, to,
                 sums.data());
}

}  // namespace gs::cuda
