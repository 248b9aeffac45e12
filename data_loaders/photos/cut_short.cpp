// SPDX-License-Identifier: Apache-2.0
// One function for each format; the first bytes of a file choose among them, never its name.
#include "data_loaders/photos/cut_short.h"

#include <algorithm>
#include <cstdint>
#include <string>
#include <string_view>

#include "data_loaders/photos/picture_bytes.h"
#include "gs_core/system/byte_reader.h"

namespace gs {
namespace {

using namespace std::string_view_literals;

constexpr std::size_t kTail = 1 << 16;   // bytes at the end of a large JPEG that are searched
constexpr std::size_t kLarge = 1 << 20;  // bytes; smaller files are walked through
constexpr std::string_view kEndOfImage = "\xFF\xD9"sv;  // never in the coded data before the end

/// ITU-T T.81, B.1.1: segments have lengths; in the coded data behind a start of scan, FF is
/// followed by 00 or by a restart marker.
bool jpeg_ends(std::string_view file) {
  for (std::size_t at = 2; at + 1 < file.size();) {
    at = std::min(file.find('\xFF', at), file.size());
    if (at + 1 >= file.size()) return false;
    const auto marker = static_cast<unsigned char>(file[at + 1]);
    const bool stands_alone = marker <= 0x01 || (marker >= 0xD0 && marker <= 0xD8);
    if (marker == 0xD9) return true;
    if (marker == 0xFF) {
      ++at;  // a fill byte
    } else if (stands_alone) {
      at += 2;
    } else {
      if (at + 4 > file.size()) return false;
      at += 2 + std::max<std::size_t>(std::size_t(big(file, at + 2, 2)), 2);
    }
  }
  return false;
}

/// Chunks of a length, a type and a checksum; the last one is IEND.
bool png_ends(std::string_view file) {
  for (std::size_t at = 8; at + 12 <= file.size();) {
    if (file.substr(at + 4, 4) == "IEND"sv) return true;
    const std::uint64_t length = big(file, at, 4);
    if (length > file.size() - at - 12) return false;
    at += 12 + std::size_t(length);
  }
  return false;
}

/// ISO 14496-12, 4.2: boxes of a length and a type, one behind the other.
bool heif_ends(std::string_view file) {
  bool has_data = false;
  std::size_t at = 0;
  while (at + 8 <= file.size()) {
    std::uint64_t length = big(file, at, 4);
    if (length == 0) return true;  // up to the end of the file
    if (length == 1) {
      if (file.size() - at < 16) return false;
      length = big(file, at + 8, 8);
    }
    if (length < 8) return true;  // damaged in another way
    if (length > file.size() - at) return false;
    has_data |= file.substr(at + 4, 4) == "mdat"sv;
    at += std::size_t(length);
  }
  return has_data || at == file.size();
}

bool webp_ends(std::string_view head, std::size_t size) { return little(head, 4, 4) + 8 <= size; }

std::string_view next(ByteReader& reader, std::size_t bytes) {
  return {reinterpret_cast<const char*>(reader.peek(bytes)), bytes};
}

}  // namespace

bool is_cut_short(const std::filesystem::path& photo) {
  ByteReader reader(photo);
  const auto size = std::size_t(reader.size());
  constexpr std::size_t kHead = 12;
  if (size < kHead) return size == 0;
  const std::string head(next(reader, kHead));
  if (head.starts_with("RIFF"sv) && head.ends_with("WEBP"sv)) return !webp_ends(head, size);
  if (head.starts_with("\x89PNG\r\n\x1A\n"sv)) return !png_ends(next(reader, size));
  if (head.substr(4, 4) == "ftyp"sv) return !heif_ends(next(reader, size));
  if (!head.starts_with("\xFF\xD8\xFF"sv)) return false;
  if (size > kLarge) {
    ByteReader tail(photo);
    tail.skip(size - kTail);
    if (next(tail, kTail).find(kEndOfImage) != std::string_view::npos) return false;
  }
  return !jpeg_ends(next(reader, size));
}

}  // namespace gs
