// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace gs {

/// `wanted` indices below `count`, evenly spread and ascending; all of them if there are fewer.
inline std::vector<std::size_t> evenly_chosen(std::size_t count, std::size_t wanted) {
  std::vector<std::size_t> indices(std::min(count, wanted));
  for (std::size_t i = 0; i < indices.size(); ++i)
    indices[i] = (2 * i + 1) * count / (2 * indices.size());
  return indices;
}

}  // namespace gs
