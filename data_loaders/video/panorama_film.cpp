// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/video/panorama_film.h"

#include <cstdint>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>

#include "gs_core/error.h"
#include "gs_core/system/byte_reader.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// A box: 4 bytes of size, 4 letters, content. ISO/IEC 14496-12
constexpr std::size_t kBoxHead = 8;

std::uint64_t big_endian(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value = value << 8 | std::uint8_t(bytes[at + i]);
  return value;
}

void set_size(std::string& bytes, std::size_t at, std::size_t size) {
  for (int i = 0; i < 4; ++i) bytes[at + i] = char(size >> (24 - 8 * i) & 255);
}

struct Box {
  std::uint64_t begin, size;
};

/// The first box of these letters between `at` and the end; those before it are passed over.
/// `read(at, count)` gives bytes.
template <class Read>
std::optional<Box> find_box(std::string_view letters, std::uint64_t at, std::uint64_t end,
                            const Read& read) {
  while (end - at >= kBoxHead) {
    const std::string head = read(at, std::min<std::uint64_t>(2 * kBoxHead, end - at));
    std::uint64_t size = big_endian(head, 0, 4);
    if (size == 1 && head.size() == 2 * kBoxHead) size = big_endian(head, kBoxHead, 8);
    if (size < kBoxHead || size > end - at) return std::nullopt;
    if (std::string_view(head).substr(4, 4) == letters) return Box{at, size};
    at += size;
  }
  return std::nullopt;
}

/// github.com/google/spatial-media, docs/spherical-video-rfc.md
std::string spherical_box() {
  const std::string content =
      "\xff\xcc\x82\x63\xf8\x55\x4a\x93\x88\x14\x58\x7a\x02\x52\x1f\xdd"
      "<?xml version=\"1.0\"?><rdf:SphericalVideo "
      "xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\" "
      "xmlns:GSpherical=\"http://ns.google.com/videos/1.0/spherical/\">"
      "<GSpherical:Spherical>true</GSpherical:Spherical>"
      "<GSpherical:Stitched>true</GSpherical:Stitched>"
      "<GSpherical:StitchingSoftware>gemsplat</GSpherical:StitchingSoftware>"
      "<GSpherical:ProjectionType>equirectangular</GSpherical:ProjectionType>"
      "</rdf:SphericalVideo>";
  std::string box(4, '\0');
  set_size(box, 0, kBoxHead + content.size());
  return box + "uuid" + content;
}

}  // namespace

bool mark_as_panorama(const fs::path& film) {
  std::fstream file(film, std::ios::binary | std::ios::in | std::ios::out);
  const auto read = [&](std::uint64_t at, std::uint64_t count) {
    std::string bytes(std::size_t(count), '\0');
    file.seekg(std::streamoff(at));
    file.read(bytes.data(), std::streamsize(count));
    return bytes;
  };
  const std::uint64_t end = fs::file_size(film);
  const auto frames = find_box("mdat", 0, end, read), index = find_box("moov", 0, end, read);
  if (!frames || !index || index->begin < frames->begin || index->size > UINT32_MAX / 2)
    return false;
  std::string tail = read(index->begin, end - index->begin);
  const auto in_tail = [&](std::uint64_t at, std::uint64_t count) {
    return tail.substr(std::size_t(at), std::size_t(count));
  };
  const auto track = find_box("trak", kBoxHead, index->size, in_tail);
  if (!track) return false;
  const std::string box = spherical_box();
  set_size(tail, 0, std::size_t(index->size) + box.size());
  set_size(tail, std::size_t(track->begin), std::size_t(track->size) + box.size());
  tail.insert(std::size_t(track->begin + track->size), box);
  file.seekp(std::streamoff(index->begin));
  file.write(tail.data(), std::streamsize(tail.size())).flush();
  if (!file) throw Error("cannot write " + film.string() + "; free some space");
  return true;
}

}  // namespace gs
