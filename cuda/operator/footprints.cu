// SPDX-License-Identifier: Apache-2.0
// Where Gaussians are in a picture by the rules of other rasterizers. A thread has one Gaussian.
#include "cuda/operator/given_rows.cuh"
#include "cuda/operator/stages.cuh"

namespace gs::cuda {
namespace {

constexpr int kThreads = 128;

template <bool has_lens>
__global__ void __launch_bounds__(kThreads)
    footprints_kernel(const __grid_constant__ OperatorInput in,
                      const __grid_constant__ SplatSettings settings, FootprintRule rule,
                      OperatorFootprints to) {
  const std::size_t i = std::size_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= in.count) return;
  const Camera camera = camera_of<has_lens>(in);
  const GivenShape shape = shape_of(in, i);
  Footprint<float> found;
  if (!shape.is_degenerate)
    found = footprint(camera, to_camera(camera, vector_at(in.arrays.means[i])), shape.sigma,
                      shape.opacity, settings, rule);
  if (to.means2d) store(to.means2d + 2 * i, found.mean2d);
  if (to.depths) to.depths[i] = found.depth;
  if (to.conics) store(to.conics + 3 * i, {found.conic.xx, found.conic.xy, found.conic.yy});
  if (to.compensations) to.compensations[i] = found.compensation;
  if (to.radii) to.radii[2 * i] = found.radius_x, to.radii[2 * i + 1] = found.radius_y;
}

}  // namespace

void footprints(Context& context, const OperatorInput& input, const SplatSettings& settings,
                const FootprintRule& rule, const OperatorFootprints& to) {
  const auto kernel = input.camera.has_lens() ? footprints_kernel<true> : footprints_kernel<false>;
  context.launch("footprints", kernel, blocks_for(input.count, kThreads), kThreads, input, settings,
                 rule, to);
}

}  // namespace gs::cuda
