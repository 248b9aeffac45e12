// SPDX-License-Identifier: Apache-2.0
// What density control looks at, and the sums of a batch.
#include "gs_core/math/density/density.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stages.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

void add(Span<const float> from, float weight, Span<float> to) {
  parallel_for(to.size, 16384, [=](std::size_t i) { to[i] += weight * from[i]; });
}

}  // namespace

void gather_statistics(const RenderPass& pass, Span<const Vec2f> dL_dmean2d,
                       DensityStatistics& statistics) {
  parallel_for(dL_dmean2d.size, 4096, [&](std::size_t i) {
    if (!pass.tile_counts[i]) return;
    statistics.visits[i] += 1.0f;
    statistics.gradient_norm[i] += screen_gradient_norm(dL_dmean2d[i], pass.width, pass.height);
  });
  if (statistics.has_sums && !pass.scratch<ScalarScratch>().fragment_sums.empty())
    add_fragment_sums(pass, statistics.sums.span());
}

void add_fragment_sums(const RenderPass& pass, Span<FragmentSums> to) {
  parallel_for(to.size, 4096, [&](std::size_t i) {
    if (pass.tile_counts[i]) add_to(to[i], fragment_sums_of(pass, i));
  });
}

void add_statistics(const DensityStatistics& from, DensityStatistics& to) {
  add(from.visits.span(), 1, to.visits.span());
  add(from.gradient_norm.span(), 1, to.gradient_norm.span());
  if (!to.has_sums) return;
  const Span<FragmentSums> sums = to.sums.span(), more = from.sums.span();
  parallel_for(sums.size, 4096, [=](std::size_t i) { add_to(sums[i], more[i]); });
}

void add_weighted(const Gaussians& from, float weight, Gaussians& to) {
  for_each_array([&](const char*, auto& sums,
                     const auto& array) { add(numbers_of(array), weight, numbers_of(sums)); },
                 to, from);
}

}  // namespace gs
