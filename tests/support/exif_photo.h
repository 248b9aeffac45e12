// SPDX-License-Identifier: Apache-2.0
// JPEG photos with tags of EXIF that say how they were exposed or where they were taken, written tag
// by tag, so that their tests depend on no writer of EXIF.
#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/photos/encode/encode_jpeg.h"
#include "gs_core/geodesy/geodetic.h"
#include "tests/support/temp_folder.h"

namespace gs {

/// A TIFF whose first directory has one tag, which leads to that of the tags.
class ExifTiff {
 public:
  /// `directory`: the tag of the first one.
  ExifTiff(std::uint32_t directory, std::uint32_t tags, bool is_big = false)
      : bytes_(is_big ? "MM" : "II"), behind_at_(kBegin + 2 + 12 * tags + 4), is_big_(is_big) {
    put(bytes_, 42, 2), put(bytes_, 8, 4), put(bytes_, 1, 2);
    put(bytes_, directory, 2), put(bytes_, 4, 2), put(bytes_, 1, 4), put(bytes_, kBegin, 4);
    put(bytes_, 0, 4), put(bytes_, tags, 2);
  }
  /// A tag of a number of one or two bytes, or of one letter.
  void add(std::uint32_t tag, std::uint32_t type, int size, std::uint32_t value) {
    constexpr std::uint32_t kText = 2;
    begin(tag, type, type == kText ? 2 : 1);
    put(bytes_, value, size), put(bytes_, 0, 4 - size);
  }
  /// A tag of fractions, each with as many steps.
  struct Fraction {
    double value;
    std::uint32_t steps;
  };
  void add(std::uint32_t tag, const std::vector<Fraction>& values) {
    constexpr std::uint32_t kRational = 5;
    begin(tag, kRational, std::uint32_t(values.size()));
    put(bytes_, behind_at_ + std::uint32_t(behind_.size()), 4);
    for (const auto& [value, steps] : values)
      put(behind_, std::uint32_t(std::lround(value * steps)), 4), put(behind_, steps, 4);
  }
  /// After all tags.
  std::string bytes() const { return bytes_ + std::string(4, '\0') + behind_; }

 private:
  static constexpr std::uint32_t kBegin = 26;  // of the tags' directory, in bytes
  void begin(std::uint32_t tag, std::uint32_t type, std::uint32_t count) {
    put(bytes_, tag, 2), put(bytes_, type, 2), put(bytes_, count, 4);
  }
  void put(std::string& to, std::uint32_t value, int count) const {
    for (int i = 0; i < count; ++i) to += char(value >> 8 * (is_big_ ? count - 1 - i : i) & 255);
  }
  std::string bytes_, behind_;
  std::uint32_t behind_at_;
  bool is_big_;
};

/// The EXIF part of a JPEG (APP1) that holds this TIFF.
inline std::string exif_segment(const std::string& tiff) {
  const std::size_t length = 2 + 6 + tiff.size();
  return std::string("\xff\xe1") + char(length >> 8) + char(length & 255) +
         std::string("Exif\0\0", 6) + tiff;
}
/// The bytes of a gray JPEG with that part.
inline std::string gray_photo_with_exif(int width, int height, const std::string& tiff) {
  const std::vector<std::uint8_t> jpeg = encode_jpeg(Image8(width, height, 3, 128), 90);
  std::string bytes(jpeg.begin(), jpeg.end());
  return bytes.insert(2, exif_segment(tiff));
}

/// Thousandths are written; 0: the tag is left out.
struct Exposed {
  double seconds = 0, f_number = 0;
  std::uint32_t iso = 0;
};
inline std::string exposure_tiff(const Exposed& exposed, bool is_big = false) {
  ExifTiff tiff(0x8769, (exposed.seconds > 0) + (exposed.f_number > 0) + (exposed.iso > 0), is_big);
  if (exposed.seconds > 0) tiff.add(0x829A, {{exposed.seconds, 1000}});
  if (exposed.f_number > 0) tiff.add(0x829D, {{exposed.f_number, 1000}});
  if (exposed.iso > 0) tiff.add(0x8827, 3, 2, exposed.iso);
  return tiff.bytes();
}
inline std::string exposed_photo(int width, int height, const Exposed& exposed,
                                 bool is_big = false) {
  return gray_photo_with_exif(width, height, exposure_tiff(exposed, is_big));
}

/// Writes a gray JPEG with six GPS tags.
inline void write_gps_photo(const std::filesystem::path& path, int width, int height,
                            const Geodetic& place) {
  const auto angle = [](double degrees) {
    const double size = std::abs(degrees), whole = std::floor(size),
                 minutes = std::floor((size - whole) * 60);
    return std::vector<ExifTiff::Fraction>{
        {whole, 1}, {minutes, 1}, {(size - whole) * 3600 - minutes * 60, 1'000'000}};
  };
  ExifTiff tiff(0x8825, 6);
  tiff.add(1, 2, 1, place.latitude < 0 ? 'S' : 'N');
  tiff.add(2, angle(place.latitude));
  tiff.add(3, 2, 1, place.longitude < 0 ? 'W' : 'E');
  tiff.add(4, angle(place.longitude));
  tiff.add(5, 1, 1, place.height < 0 ? 1 : 0);
  tiff.add(6, {{std::abs(place.height), 1000}});
  write_bytes(path, gray_photo_with_exif(width, height, tiff.bytes()));
}

}  // namespace gs
