// SPDX-License-Identifier: Apache-2.0
// The checksum of zip archives and PNG files.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace gs {

constexpr std::array<std::uint32_t, 256> crc_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    table[i] = i;
    for (int bit = 0; bit < 8; ++bit)
      table[i] = table[i] & 1 ? table[i] >> 1 ^ 0xEDB88320u : table[i] >> 1;
  }
  return table;
}

/// CRC-32 of zip, gzip and PNG: polynomial 0x04C11DB7, bits reflected.
inline std::uint32_t crc32_of(std::string_view bytes) {
  static constexpr std::array<std::uint32_t, 256> kTable = crc_table();
  std::uint32_t crc = ~0u;
  for (const char c : bytes) crc = crc >> 8 ^ kTable[(crc ^ std::uint8_t(c)) & 255];
  return ~crc;
}

}  // namespace gs
