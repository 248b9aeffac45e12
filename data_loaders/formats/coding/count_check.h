// SPDX-License-Identifier: Apache-2.0
// How many Gaussians a compressed file can hold.
#pragma once

#include <spdlog/fmt/fmt.h>

#include "gs_core/io/byte_reader.h"

namespace gs {

/// Most Gaussians for each byte of a compressed file. Real ones hold one in 5 bytes or more; what promises over a thousand times
/// that is damaged, or made to exhaust memory.
inline constexpr std::uint64_t kMostPerByte = 256;

/// Throws Error where a file of so many bytes cannot hold `count` Gaussians. To be asked before memory is.
inline void check_count(const std::filesystem::path& path, std::uint64_t count,
                        std::uint64_t bytes) {
  if (count > kMostPerByte * bytes)
    cannot_read(path, fmt::format("it promises {} Gaussians in {} bytes; the file is damaged, copy "
                                  "or export it again",
                                  count, bytes));
}

}  // namespace gs
