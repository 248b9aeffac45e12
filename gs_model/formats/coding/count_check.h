// SPDX-License-Identifier: Apache-2.0
// Refuses a compressed file that promises more Gaussians than its size can hold.
#pragma once

#include <spdlog/fmt/fmt.h>

#include "gs_core/system/byte_reader.h"

namespace gs {

/// Most Gaussians in a compressed file of any size, and bytes for each one beyond them. Real files
/// take 5 bytes or more for one. A Gaussian takes 300 bytes of memory and more while it is read, so
/// a file that promises more than it can hold would exhaust the memory before that is found out.
inline constexpr std::uint64_t kAlwaysAllowed = 1 << 16, kLeastBytesEach = 2;

/// Throws Error where a file of `bytes` bytes cannot hold `count` Gaussians. Call it before memory
/// is allocated.
inline void check_count(const std::filesystem::path& path, std::uint64_t count,
                        std::uint64_t bytes) {
  if (count > kAlwaysAllowed + bytes / kLeastBytesEach)
    cannot_read(path, fmt::format("it promises {} Gaussians in {} bytes; the file is damaged, copy "
                                  "or export it again",
                                  count, bytes));
}

}  // namespace gs
