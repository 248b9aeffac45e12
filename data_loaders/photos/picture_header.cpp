// SPDX-License-Identifier: Apache-2.0
// One function for each format; the first bytes of a file choose among them, never its name.
#include "data_loaders/photos/picture_header.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <limits>
#include <string>
#include <string_view>
#include <utility>

#include "data_loaders/photos/exr_header.h"
#include "data_loaders/photos/photo_codec.h"
#include "data_loaders/photos/picture_bytes.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

// Memory that any picture may take, and bytes of memory for each byte of a larger one. A photo of 45
// million pixels as a progressive JPEG of poor quality takes 400 MiB, 90 for each of its bytes.
// A mask of 100 million pixels may be a thousand times smaller than its pixels, and takes 400 MiB.
constexpr double kAlwaysAllowed = double(512 << 20), kMemoryPerByte = 200;
// Usual progressive JPEGs have 10 scans, and each takes the time of a whole decode.
constexpr std::uint64_t kUsualScans = 24, kMostScans = 100;
constexpr double kMostScannedPixels = double(1 << 30);
constexpr std::uint64_t kMostPackedTexts = 16;  // of a PNG, up to 8 MB each
constexpr std::size_t kSearched = 1 << 16;      // bytes at the start in which boxes are looked for

/// Walks over the markers of a JPEG (ITU-T T.81, B.1.1). In the data behind a start of scan, FF is
/// followed by 00 or by a restart marker.
class JpegWalk {
 public:
  JpegWalk(const PictureFile& file, PictureHeader& header) : file_(file), header_(header) {
    std::uint64_t scans = 0;
    for (int marker = next_marker(); marker > 0; marker = next_marker()) {
      if (marker == kEndOfImage) break;
      const std::string segment = file_.bytes(at_, kSegmentBytes);
      at_ += std::max<std::uint64_t>(big(segment, 0, 2), 2);
      if (is_frame(marker)) take_frame(marker, segment);
      if (marker != kStartOfScan) continue;
      const bool is_whole = big(segment, 2, 1) == components_;
      if (++scans == 1 && is_whole && !is_progressive_) break;     // the only one
      if (scans == 1) header_.bytes_per_pixel += 2 * components_;  // all coefficients are kept
      if (scans > kMostScans) break;
    }
    header_.scans = std::max<std::uint64_t>(scans, 1);
  }

 private:
  static constexpr int kStartOfScan = 0xDA, kEndOfImage = 0xD9;
  static constexpr std::size_t kSegmentBytes = 16, kBlock = 1 << 16;

  static bool is_frame(int marker) {
    return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
  }
  void take_frame(int marker, std::string_view segment) {
    // A damaged file may have several frames, and decoders may take the first.
    header_.height = std::max(header_.height, big(segment, 3, 2));
    header_.width = std::max(header_.width, big(segment, 5, 2));
    components_ = big(segment, 7, 1);
    header_.bytes_per_pixel = std::max<std::uint64_t>({header_.bytes_per_pixel, components_, 3});
    is_progressive_ = (marker & 3) == 2;
  }
  /// The next marker that has a segment, or the end of the picture; 0 at the end of the file.
  int next_marker() {
    for (;;) {
      if (at_ < block_at_ || at_ + 1 >= block_at_ + block_.size()) {
        if (at_ + 1 >= file_.size()) return 0;
        block_ = file_.bytes(block_at_ = at_, kBlock);
        if (block_.size() < 2) return 0;
      }
      const std::string_view rest = std::string_view(block_).substr(at_ - block_at_);
      const std::size_t mark = std::min(rest.find('\xFF'), rest.size() - 1);
      at_ += mark;
      if (rest[mark] != '\xFF') {
        ++at_;
      } else if (mark + 1 < rest.size()) {
        const int marker = static_cast<unsigned char>(rest[mark + 1]);
        at_ += marker == 0xFF ? 1 : 2;  // FF may be repeated
        const bool stands_alone = marker <= 0x01 || (marker >= 0xD0 && marker <= 0xD8);
        if (!stands_alone && marker != 0xFF) return marker;
      }
    }
  }

  const PictureFile& file_;
  PictureHeader& header_;
  std::uint64_t at_ = 2, components_ = 0, block_at_ = 0;
  std::string block_;
  bool is_progressive_ = false;
};

void read_png(const PictureFile& file, std::string_view start, PictureHeader& header) {
  header.width = big(start, 16, 4);
  header.height = big(start, 20, 4);
  const std::uint64_t color_type =
      big(start, 25, 1);  // 0 gray, 2 color, 3 palette; 4, 6: with alpha
  const std::uint64_t channels = color_type == 0   ? 1
                                 : color_type == 4 ? 2
                                 : color_type == 2 ? 3
                                                   : 4;
  header.bytes_per_pixel = big(start, 24, 1) == 16 ? 2 * channels : channels;
  for (std::uint64_t at = 8; at < file.size() && header.packed_texts <= kMostPackedTexts;) {
    const std::string chunk = file.bytes(at, 8);
    const std::string_view kind =
        std::string_view(chunk).substr(std::min<std::size_t>(4, chunk.size()));
    if (kind == "IDAT" || kind.size() < 4) return;
    header.packed_texts += kind == "zTXt" || kind == "iTXt" || kind == "iCCP";
    at += 12 + big(chunk, 0, 4);
  }
}

/// The largest value of one tag of the first directory, for the tags that tell a TIFF's size.
void read_tiff(const PictureFile& file, std::string_view start, PictureHeader& header) {
  const bool is_little = start[0] == 'I', is_large = start[is_little ? 2 : 3] == 43;
  const auto number = [&](std::string_view bytes, std::size_t at, std::size_t count) {
    return is_little ? little(bytes, at, count) : big(bytes, at, count);
  };
  const std::uint64_t directory = is_large ? number(start, 8, 8) : number(start, 4, 4);
  const std::size_t count_bytes = is_large ? 8 : 2, entry_bytes = is_large ? 20 : 12;
  const std::uint64_t entries =
      std::min<std::uint64_t>(number(file.bytes(directory, count_bytes), 0, count_bytes), 4096);
  const std::string table = file.bytes(directory + count_bytes, std::size_t(entries) * entry_bytes);
  std::uint64_t tile_width = 0, tile_height = 0, samples = 1, bits = 8;
  for (std::size_t at = 0; at + entry_bytes <= table.size(); at += entry_bytes) {
    const std::uint64_t tag = number(table, at, 2), type = number(table, at + 2, 2);
    const std::uint64_t many = number(table, at + 4, is_large ? 8 : 4);
    const std::size_t value_bytes = type == 1 ? 1 : type == 3 ? 2 : type == 16 ? 8 : 4;
    const std::uint64_t value = number(table, at + (is_large ? 12 : 8), value_bytes);
    if (tag == 256) header.width = value;
    if (tag == 257) header.height = value;
    if (tag == 258) bits = many * value_bytes > (is_large ? 8 : 4) ? 32 : value;
    if (tag == 277) samples = value;
    if (tag == 322) tile_width = value;
    if (tag == 323) tile_height = value;
  }
  header.width = std::max(header.width, tile_width);
  header.height = std::max(header.height, tile_height);
  header.bytes_per_pixel =
      std::max<std::uint64_t>(samples, 1) * std::max<std::uint64_t>(bits / 8, 1) + 4;
}

/// A chunk of WebP (RFC 9649) and what it holds.
void read_webp(std::string_view kind, std::string_view chunk, PictureHeader& header) {
  header.bytes_per_pixel = 8;
  if (kind == "VP8X") {
    header.width = little(chunk, 4, 3) + 1;
    header.height = little(chunk, 7, 3) + 1;
  } else if (kind == "VP8L") {
    const std::uint64_t packed = little(chunk, 1, 4);
    header.width = (packed & 0x3FFF) + 1;
    header.height = (packed >> 14 & 0x3FFF) + 1;
  } else {
    header.width = little(chunk, 6, 2) & 0x3FFF;
    header.height = little(chunk, 8, 2) & 0x3FFF;
  }
}

void read_bmp(std::string_view start, PictureHeader& header) {
  const bool is_old = little(start, 14, 4) == 12;
  const auto side = [&](std::size_t at) {  // the height is negative where rows go down
    const auto value = std::int32_t(little(start, at, 4));
    return std::uint64_t(value < 0 ? -std::int64_t(value) : std::int64_t(value));
  };
  header.width = is_old ? little(start, 18, 2) : side(18);
  header.height = is_old ? little(start, 20, 2) : side(22);
  header.bytes_per_pixel = 8;
}

/// The largest picture that an `ispe` box of a HEIF (ISO 23008-12) or AVIF names.
void read_heif(std::string_view start, PictureHeader& header) {
  header.bytes_per_pixel = 8;
  for (std::size_t at = start.find("ispe"); at != start.npos; at = start.find("ispe", at + 4)) {
    const std::uint64_t width = big(start, at + 8, 4), height = big(start, at + 12, 4);
    if (double(width) * double(height) <= double(header.width) * double(header.height)) continue;
    header.width = width;
    header.height = height;
  }
}

/// The SIZ marker of a JPEG 2000 codestream (ITU-T T.800, A.5.1).
void read_jpeg_2000(std::string_view start, PictureHeader& header) {
  const std::size_t at = start.find("\xFF\x4F\xFF\x51");
  if (at == start.npos) return;
  header.width = big(start, at + 8, 4);
  header.height = big(start, at + 12, 4);
  header.bytes_per_pixel = 4 * std::max<std::uint64_t>(big(start, at + 40, 2), 1) + 4;
}

}  // namespace

PictureHeader read_picture_header(const fs::path& path) {
  using namespace std::string_view_literals;
  const PictureFile file(path);
  PictureHeader header;
  header.file_bytes = file.size();
  const std::string first = file.bytes(0, 64);
  const std::string_view start = first;
  const auto long_start = [&] { return file.bytes(0, kSearched); };
  if (start.starts_with("\xFF\xD8\xFF")) {
    JpegWalk(file, header);
  } else if (start.starts_with("\x89PNG\r\n\x1A\n")) {
    read_png(file, start, header);
  } else if (start.starts_with("GIF")) {  // giflib looks at no more
    header.width = little(start, 6, 2);
    header.height = little(start, 8, 2);
    header.bytes_per_pixel = 8;
    header.is_photo_format = false;
  } else if (start.starts_with("II\x2A\0"sv) || start.starts_with("II\x2B\0"sv) ||
             start.starts_with("MM\0\x2A"sv) || start.starts_with("MM\0\x2B"sv)) {
    read_tiff(file, start, header);
  } else if (start.starts_with("BM")) {
    read_bmp(start, header);
  } else if (start.starts_with("RIFF") && start.find("WEBP") == 8) {
    read_webp(start.substr(12, 4), start.substr(std::min<std::size_t>(20, start.size())), header);
  } else if (start.size() > 12 && start.substr(4, 4) == "ftyp") {
    read_heif(long_start(), header);
  } else if (start.starts_with("\0\0\0\x0CjP"sv) || start.starts_with("\xFF\x4F\xFF\x51")) {
    read_jpeg_2000(long_start(), header);
  } else if (start.starts_with("\x76\x2F\x31\x01")) {
    read_exr_header(file, header);
  } else if (start.size() > 4 && start[0] == '/' && (start[4] & 0xE0) == 0) {
    read_webp("VP8L", start, header);  // libwebp also opens what a chunk holds
  } else if (start.find("\x9D\x01\x2A") == 3) {
    read_webp("VP8 ", start, header);
  }
  return header;
}

void check_picture(const fs::path& path, const PictureHeader& header) {
  const double pixels = double(header.width) * double(header.height);
  const auto says = [&] {
    return fmt::format("its header says {} x {} pixels", header.width, header.height);
  };
  if (header.is_damaged)
    cannot_read_photo(path, "a part of its header is longer than the file, or than its kind is");
  if (pixels > double(kMostPixels)) cannot_read_photo(path, says());
  const double memory = pixels * double(header.bytes_per_pixel);
  const double allowed = header.is_photo_format ? kMemoryPerByte * double(header.file_bytes) : 0;
  if (memory > std::max(allowed, kAlwaysAllowed))
    cannot_read_photo(
        path, fmt::format("{}, which take {:.0f} MiB of memory, in a file of {} bytes", says(),
                          memory / (1 << 20), header.file_bytes));
  const bool has_too_many_scans =
      header.scans > kMostScans ||
      (header.scans > kUsualScans && double(header.scans) * pixels > kMostScannedPixels);
  if (has_too_many_scans)
    cannot_read_photo(path, fmt::format("it is a progressive JPEG of {} scans or more, and photos "
                                        "have about 10; save it again",
                                        header.scans));
  if (header.packed_texts > kMostPackedTexts)
    cannot_read_photo(path, "it holds more compressed notes than pictures have");
}

}  // namespace gs
