// SPDX-License-Identifier: Apache-2.0
#include "gs_model/formats/coding/morton_rows.h"

#include <algorithm>
#include <numeric>

#include "gs_core/math/density/morton.h"
#include "gs_model/formats/coding/finite_rows.h"

namespace gs {

std::vector<std::uint32_t> morton_order(const Buffer<Vec3f>& means) {
  std::vector<std::uint32_t> order(means.size());
  std::iota(order.begin(), order.end(), 0u);
  if (order.empty()) return order;
  Vec3f low = means[0], high = means[0];
  for (const Vec3f& mean : means) {
    for (int axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], mean[axis]);
      high[axis] = std::max(high[axis], mean[axis]);
    }
  }
  const float size = std::max({high.x - low.x, high.y - low.y, high.z - low.z, 1e-30f});
  std::vector<std::uint64_t> codes(means.size());
  for (std::size_t i = 0; i < codes.size(); ++i) codes[i] = morton_code(means[i], low, size);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return codes[a] < codes[b]; });
  return order;
}

GaussianModel in_morton_order(const GaussianModel& model) {
  return rows_of(model, morton_order(model.gaussians.mean));
}

}  // namespace gs
