// SPDX-License-Identifier: Apache-2.0
// The compressor of PNG files. Filtered rows of photos hold few strings twice, so that codes of
// variable length and runs of one byte give nearly all that zlib's search for strings would, in a
// tenth of its time.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace gs {

/// Appends a block that holds `bytes` in the format of Deflate (RFC 1951), with codes of its own. It
/// ends at a whole byte, so that blocks that were made side by side follow each other.
void append_deflated(std::span<const std::uint8_t> bytes, bool is_last, std::string& out);

}  // namespace gs
