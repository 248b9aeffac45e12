// SPDX-License-Identifier: Apache-2.0
// Writes a video without an encoder: an AVI file of uncompressed frames.
#pragma once

#include "tests/support/colmap_writer.h"

namespace gs {

/// The frames' bytes as AVI has them: bottom row first, blue before red. `frame` has a width that
/// is a multiple of 4.
inline std::string avi_frame(const Image8& frame) {
  std::string bytes;
  for (int y = frame.height; y-- > 0;)
    for (int x = 0; x < frame.width; ++x)
      for (const int c : {2, 1, 0}) bytes.push_back(char(frame.at(x, y, c)));
  return bytes;
}

inline std::string avi_chunk(const std::string& name, const std::string& content) {
  return Bytes().add_text(name).add<std::uint32_t>(content.size()).add_text(content).str();
}

/// Frames of one size, 30 a second.
inline void write_avi(const std::filesystem::path& file, const std::vector<Image8>& frames) {
  using u16 = std::uint16_t;
  using u32 = std::uint32_t;
  const u32 width = u32(frames.at(0).width), height = u32(frames[0].height);
  const u32 bytes = 3 * width * height, count = u32(frames.size());
  Bytes main, stream, format, index;
  for (const u32 value :
       {33333u, 30 * bytes, 0u, 0x10u, count, 0u, 1u, bytes, width, height, 0u, 0u, 0u, 0u})
    main.add(value);
  stream.add_text("vidsDIB ");
  for (const u32 value : {0u, 0u, 0u, 1u, 30u, 0u, count, bytes, ~0u, 0u, 0u, 0u})
    stream.add(value);
  format.add(u32(40)).add(width).add(height).add(u16(1)).add(u16(24)).add(u32(0)).add(bytes);
  for (int i = 0; i < 4; ++i) format.add(u32(0));
  std::string movie = "movi";
  for (const Image8& frame : frames) {
    index.add_text("00db").add(u32(0x10)).add(u32(movie.size())).add(bytes);
    movie += avi_chunk("00db", avi_frame(frame));
  }
  const std::string streams =
      avi_chunk("LIST", "strl" + avi_chunk("strh", stream.str()) + avi_chunk("strf", format.str()));
  const std::string header = avi_chunk("LIST", "hdrl" + avi_chunk("avih", main.str()) + streams);
  write_bytes(file, avi_chunk("RIFF", "AVI " + header + avi_chunk("LIST", movie) +
                                          avi_chunk("idx1", index.str())));
}

}  // namespace gs
