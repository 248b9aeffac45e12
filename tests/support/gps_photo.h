// SPDX-License-Identifier: Apache-2.0
// JPEG photos with GPS tags, written tag by tag, so that their tests depend on no writer of EXIF.
#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>

#include "gs_core/geodesy/geodetic.h"
#include "tests/support/exif_segment.h"
#include "tests/support/temp_folder.h"

namespace gs {

/// The TIFF of an EXIF part with six GPS tags.
class GpsTags {
 public:
  explicit GpsTags(const Geodetic& place) {
    constexpr std::uint32_t kIfd = 26, kData = kIfd + 2 + 6 * 12 + 4;  // bytes of the TIFF part
    bytes_ = std::string("II*\0", 4);
    put(8, 4);  // the first directory: one tag, which says where the one of GPS is
    put(1, 2), put(0x8825, 2), put(4, 2), put(1, 4), put(kIfd, 4), put(0, 4);
    put(6, 2);
    text_tag(1, place.latitude < 0 ? 'S' : 'N');
    tag(2, 5, 3, kData);
    text_tag(3, place.longitude < 0 ? 'W' : 'E');
    tag(4, 5, 3, kData + 24);
    tag(5, 1, 1, place.height < 0 ? 1 : 0);
    tag(6, 5, 1, kData + 48);
    put(0, 4);
    angle(std::abs(place.latitude));
    angle(std::abs(place.longitude));
    rational(std::abs(place.height), 1000);
  }

  const std::string& tiff() const { return bytes_; }

 private:
  void put(std::uint32_t value, int count) {
    for (int i = 0; i < count; ++i) bytes_ += char(value >> 8 * i & 255);
  }
  void tag(std::uint32_t number, std::uint32_t type, std::uint32_t count, std::uint32_t value) {
    put(number, 2), put(type, 2), put(count, 4), put(value, 4);
  }
  void text_tag(std::uint32_t number, char letter) { tag(number, 2, 2, std::uint8_t(letter)); }
  void rational(double value, std::uint32_t steps) {
    put(std::uint32_t(std::lround(value * steps)), 4), put(steps, 4);
  }
  void angle(double degrees) {
    const double whole = std::floor(degrees), minutes = std::floor((degrees - whole) * 60);
    rational(whole, 1);
    rational(minutes, 1);
    rational((degrees - whole) * 3600 - minutes * 60, 1'000'000);
  }

  std::string bytes_;
};

/// Writes a gray JPEG with these GPS tags.
inline void write_gps_photo(const std::filesystem::path& path, int width, int height,
                            const Geodetic& place) {
  write_bytes(path, gray_photo_with_exif(width, height, GpsTags(place).tiff()));
}

}  // namespace gs
