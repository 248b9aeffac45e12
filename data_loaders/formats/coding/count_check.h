// SPDX-License-Identifier: Apache-2.0
// Refuses a compressed file that promises more Gaussians than its size can hold.
#pragma once

#include <spdlog/fmt/fmt.h>

#include "gs_core/io/byte_reader.h"

namespace gs {

/// Most Gaussians for each byte of a compressed file. Real files take 5 bytes or more for one; a
/// file that promises a thousand times as many is damaged, or made to exhaust memory.
inline constexpr std::uint64_t kMostPerByte = 256;

/// Throws Error where a file of `bytes` bytes cannot hold `count` Gaussians. Call it before memory
/// is allocated.
inline void check_count(const std::filesystem::path& path, std::uint64_t count,
                        std::uint64_t bytes) {
  if (count > kMostPerByte * bytes)
    cannot_read(path, fmt::format("it promises {} Gaussians in {} bytes; the file is damaged, copy "
                                  "or export it again",
                                  count, bytes));
}

}  // namespace gs
