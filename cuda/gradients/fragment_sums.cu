// SPDX-License-Identifier: Apache-2.0
// After stage 6, for the score "force" of density control: the gathering of the sums over fragments.
#include "cuda/gradients/fragment_sums.cuh"

#include "cuda/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 256;  // pixels and rows are independent: any size that fills the GPU

__device__ std::size_t thread_number() { return std::size_t(blockIdx.x) * kThreads + threadIdx.x; }

// Sums that have memory of their own. `scale` is that of the forces; 1 for sums in fixed point, which
// were scaled before they were rounded. Clears the sums of the photo, also where
// a step is not to be counted.
__global__ void gather_kernel(Span<FragmentSums> statistics, Vec4f* sums, FixedFragmentSums* fixed,
                              float scale, const std::uint32_t* halted, Shard shard) {
  const std::size_t i = thread_number(), projected = shard.row_of_all(i);
  if (i >= statistics.size) return;
  FragmentSums share;
  if (fixed) {
    share = sums_of(fixed[projected]);
    fixed[projected] = {};
  } else {
    share = {sums[projected].x, sums[projected].y, sums[projected].z};
    sums[projected] = {0, 0, 0, 0};
  }
  if (*halted || share.count == 0) return;
  add_to(statistics[i], scaled_forces(share, scale));
}

__global__ void add_sums_kernel(Span<FragmentSums> to, FragmentSums* from,
                                const std::uint32_t* halted) {
  const std::size_t i = thread_number();
  if (i >= to.size || (halted && *halted)) return;
  add_to(to[i], from[i]);
  from[i] = {};
}

}  // namespace

void gather_fragment_sums(Context& context, const PhotoRows& photo, Span<FragmentSums> to,
                          const std::uint32_t* halted, const Shard& shard) {
  const RenderSettings& settings = photo.settings;
  if (sums_among_gradients(settings)) return;
  const StageScope scope(context, "statistics");
  const float scale = settings.deterministic ? 1.0f : force_scale(photo.pixel_count());
  context.launch("statistics", gather_kernel, blocks_for(to.size, kThreads), kThreads, to,
                 photo.fragment_sums, settings.deterministic ? photo.fixed_fragment_sums : nullptr,
                 scale, halted, shard);
}

void add_fragment_sums(Context& context, Span<FragmentSums> to, Span<FragmentSums> from,
                       const std::uint32_t* halted) {
  GS_CHECK(to.size == from.size);
  context.launch("statistics", add_sums_kernel, blocks_for(to.size, kThreads), kThreads, to,
                 from.data, halted);
}

}  // namespace gs::cuda
