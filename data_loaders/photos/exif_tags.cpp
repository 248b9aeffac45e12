// SPDX-License-Identifier: Apache-2.0
// EXIF is a TIFF file within an APP1 segment of a JPEG (EXIF 2.3, 4.5; TIFF 6.0, section 2): a
// directory of tags of 12 bytes each, one of which leads to the directory with the tags of the
// photo. Nothing in it is trusted: all places are checked against the end of the segment.
#include "data_loaders/photos/exif_tags.h"

#include <algorithm>
#include <cstring>
#include <optional>

namespace gs {
namespace {

constexpr std::uint16_t kOrientation = 0x0112, kExifDirectory = 0x8769, kExposureTime = 0x829A,
                        kFNumber = 0x829D, kIso = 0x8827, kFocalLength = 0x920A;
constexpr std::uint32_t kShort = 3, kLong = 4, kRational = 5;  // types of values
constexpr std::size_t kTagBytes = 12;
constexpr std::size_t kExifName = 6;  // "Exif" and two zeros, before the TIFF file

/// The TIFF file of an EXIF segment.
class TiffTags {
 public:
  explicit TiffTags(Span<const std::uint8_t> bytes) : bytes_(bytes) {
    is_big_ = bytes.size > 1 && bytes[0] == 'M' && bytes[1] == 'M';
  }
  bool is_tiff() const {
    return bytes_.size > 1 && bytes_[0] == bytes_[1] && (is_big_ || bytes_[0] == 'I') &&
           number(2, 2) == 42;
  }
  std::uint32_t first_directory() const { return number(4, 4).value_or(0); }
  /// The value of a tag of a directory, or its first one; 0 if there is none.
  double value(std::uint32_t directory, std::uint16_t tag) const {
    const std::optional<std::uint64_t> at = place_of(directory, tag);
    return at ? value_at(*at) : 0;
  }
  /// Where a tag of a directory begins.
  std::optional<std::uint64_t> place_of(std::uint32_t directory, std::uint16_t tag) const {
    const std::uint32_t count = number(directory, 2).value_or(0);
    for (std::uint32_t i = 0; i < count; ++i) {
      const std::uint64_t at = std::uint64_t(directory) + 2 + kTagBytes * i;
      if (number(at, 2) == tag) return at;
    }
    return {};
  }
  bool is_big() const { return is_big_; }

 private:
  double value_at(std::uint64_t tag) const {
    switch (number(tag + 2, 2).value_or(0)) {
      case kShort: return number(tag + 8, 2).value_or(0);
      case kLong: return number(tag + 8, 4).value_or(0);
      case kRational: {
        const std::uint64_t at = number(tag + 8, 4).value_or(0);
        const double below = number(at + 4, 4).value_or(0);
        return below > 0 ? number(at, 4).value_or(0) / below : 0;
      }
      default: return 0;
    }
  }
  /// The number of `count` bytes at a place; none beyond the end.
  std::optional<std::uint32_t> number(std::uint64_t at, std::size_t count) const {
    if (at > bytes_.size || bytes_.size - at < count) return {};
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < count; ++i)
      value = value << 8 | bytes_[std::size_t(at) + (is_big_ ? i : count - 1 - i)];
    return value;
  }

  Span<const std::uint8_t> bytes_;
  bool is_big_ = false;
};

/// The TIFF file in the EXIF segment of a JPEG; empty if there is none. Only segments before the
/// pixels are looked at.
Span<const std::uint8_t> exif_of_jpeg(Span<const std::uint8_t> head) {
  constexpr std::uint8_t kApp1 = 0xE1, kStartOfScan = 0xDA;
  if (head.size < 2 || head[0] != 0xFF || head[1] != 0xD8) return {};
  for (std::size_t at = 2; head.size - at >= 4 && head[at] == 0xFF;) {
    const std::uint8_t marker = head[at + 1];
    const std::size_t length = std::size_t(head[at + 2] << 8 | head[at + 3]);
    if (marker == kStartOfScan || length < 2 || length > head.size - at - 2) return {};
    const std::uint8_t* const segment = head.data + at + 4;
    if (marker == kApp1 && length >= 2 + kExifName &&
        std::memcmp(segment, "Exif\0\0", kExifName) == 0)
      return {segment + kExifName, length - 2 - kExifName};
    at += 2 + length;
  }
  return {};
}

}  // namespace

ExposureTags exposure_tags_of_jpeg(Span<const std::uint8_t> head) {
  const TiffTags tiff(exif_of_jpeg(head));
  if (!tiff.is_tiff()) return {};
  const auto photo = std::uint32_t(tiff.value(tiff.first_directory(), kExifDirectory));
  if (photo == 0) return {};
  return {tiff.value(photo, kExposureTime), tiff.value(photo, kFNumber), tiff.value(photo, kIso)};
}

int orientation_of_jpeg(Span<const std::uint8_t> head) {
  const TiffTags tiff(exif_of_jpeg(head));
  const double value = tiff.is_tiff() ? tiff.value(tiff.first_directory(), kOrientation) : 0;
  return value > 0 ? int(std::min(value, 255.0)) : 1;
}

bool has_focal_length_of_jpeg(Span<const std::uint8_t> head) {
  const TiffTags tiff(exif_of_jpeg(head));
  if (!tiff.is_tiff()) return false;
  const auto photo = std::uint32_t(tiff.value(tiff.first_directory(), kExifDirectory));
  return photo != 0 && tiff.value(photo, kFocalLength) > 0;
}

std::vector<std::uint8_t> upright_exif_of_jpeg(Span<const std::uint8_t> head) {
  constexpr std::size_t kBeforeTiff = 4 + kExifName;  // marker and length of the segment, name
  const Span<const std::uint8_t> exif = exif_of_jpeg(head);
  const TiffTags tiff(exif);
  if (!tiff.is_tiff()) return {};
  std::vector<std::uint8_t> segment(exif.data - kBeforeTiff, exif.data + exif.size);
  const auto tag = tiff.place_of(tiff.first_directory(), kOrientation);
  if (!tag || *tag + kTagBytes > exif.size) return segment;
  const auto value = segment.begin() + kBeforeTiff + std::ptrdiff_t(*tag) + 8;
  std::fill_n(value, 4, std::uint8_t(0));  // one number of 2 bytes, at the beginning of the 4
  *(value + (tiff.is_big() ? 1 : 0)) = 1;
  return segment;
}

}  // namespace gs
