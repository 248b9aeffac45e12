// SPDX-License-Identifier: Apache-2.0
// Stage 10: the order of rows along the Morton curve, so that neighbors in space are neighbors in
// memory.   Faster-GS
#include "gs_core/math/density/morton.h"

#include <numeric>

#include "gs_core/threads/parallel.h"
#include "gs_core/threads/radix_sort.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {

Buffer<std::uint32_t> morton_order(Span<const Vec3f> means, Span<const float> time_means,
                                   Span<const float> log_time_scales) {
  Vec3f low(1e30f), high(-1e30f);
  for (const Vec3f& mean : means)
    for (int axis = 0; axis < 3; ++axis) {
      if (!std::isfinite(mean[axis])) continue;
      low[axis] = std::min(low[axis], mean[axis]);
      high[axis] = std::max(high[axis], mean[axis]);
    }
  const float size =
      std::max({high.x - low.x, high.y - low.y, high.z - low.z, std::numeric_limits<float>::min()});

  std::vector<std::uint64_t> codes(means.size);
  parallel_for(means.size, 4096, [&](std::size_t i) {
    codes[i] = morton_code(means[i], low, size);
    if (!time_means.empty()) codes[i] = spacetime_code(codes[i], time_means[i], log_time_scales[i]);
  });
  Buffer<std::uint32_t> order(means.size, host_memory()), scratch;
  std::iota(order.begin(), order.end(), 0u);
  radix_sort_by_key(order.span(), scratch, [&](std::uint32_t i) { return codes[i]; });
  return order;
}

}  // namespace gs
