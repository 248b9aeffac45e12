// SPDX-License-Identifier: Apache-2.0
// Where stb_image_write writes to.
#pragma once

#include <cstdint>
#include <vector>

namespace gs {

/// A callback of stb_image_write: adds `size` bytes at the end of a std::vector<std::uint8_t>.
inline void append_stb_bytes(void* vector, void* data, int size) {
  auto& bytes = *static_cast<std::vector<std::uint8_t>*>(vector);
  const auto* const first = static_cast<const std::uint8_t*>(data);
  bytes.insert(bytes.end(), first, first + size);
}

}  // namespace gs
