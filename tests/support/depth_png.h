// SPDX-License-Identifier: Apache-2.0
// Writes maps as PNG files of 16 or 8 bits, byte by byte, so that tests depend on no
// encoder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/image.h"
#include "tests/support/temp_folder.h"

namespace gs {

namespace depth_png {

inline void add_big(std::string& to, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) to += char(value >> shift & 255);
}

inline std::uint32_t crc(const std::string& bytes) {
  std::uint32_t crc = ~0u;
  for (const char byte : bytes) {
    crc ^= std::uint8_t(byte);
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0);
  }
  return ~crc;
}

inline void add_chunk(std::string& to, const std::string& kind, const std::string& data) {
  add_big(to, std::uint32_t(data.size()));
  to += kind + data;
  add_big(to, crc(kind + data));
}

/// Zlib's format, with blocks that are not compressed.
inline std::string stored(const std::string& data) {
  constexpr std::size_t kMostOfBlock = 65535;
  std::string out("\x78\x01", 2);
  std::uint32_t a = 1, b = 0;  // Adler-32
  for (std::size_t at = 0; at < data.size(); at += kMostOfBlock) {
    const std::string block = data.substr(at, kMostOfBlock);
    out += char(at + kMostOfBlock >= data.size());
    for (const std::size_t size : {block.size(), ~block.size()})
      out += {char(size & 255), char(size >> 8 & 255)};
    out += block;
  }
  for (const char byte : data) {
    a = (a + std::uint8_t(byte)) % 65521;
    b = (b + a) % 65521;
  }
  add_big(out, b << 16 | a);
  return out;
}

}  // namespace depth_png

/// Writes values, rounded to integers, of 1, 3 or 4 channels.
inline void write_depth_png(const std::filesystem::path& path, const ImageF& values,
                            int bits = 16) {
  std::string rows;
  for (int y = 0; y < values.height; ++y) {
    rows += '\0';  // no filter
    for (int x = 0; x < values.width; ++x)
      for (int c = 0; c < values.channels; ++c) {
        const auto value = std::uint32_t(values.at(x, y, c) + 0.5f);
        if (bits == 16) rows += char(value >> 8 & 255);
        rows += char(value & 255);
      }
  }
  std::string header, file("\x89PNG\r\n\x1a\n");
  depth_png::add_big(header, std::uint32_t(values.width));
  depth_png::add_big(header, std::uint32_t(values.height));
  header += {char(bits), char(values.channels == 4 ? 6 : values.channels == 3 ? 2 : 0), 0, 0, 0};
  depth_png::add_chunk(file, "IHDR", header);
  depth_png::add_chunk(file, "IDAT", depth_png::stored(rows));
  depth_png::add_chunk(file, "IEND", "");
  write_bytes(path, file);
}

}  // namespace gs
