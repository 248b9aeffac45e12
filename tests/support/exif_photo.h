// SPDX-License-Identifier: Apache-2.0
// JPEG photos with the tags of EXIF that say how they were exposed, written tag by tag, so that
// their tests depend on no writer of EXIF.
#pragma once

#include <cstdint>
#include <string>

#include "tests/support/exif_segment.h"

namespace gs {

/// Thousandths are written; 0: the tag is left out.
struct Exposed {
  double seconds = 0, f_number = 0;
  std::uint32_t iso = 0;
};

/// The TIFF of an EXIF part.
class ExposureTiff {
 public:
  explicit ExposureTiff(const Exposed& exposed, bool is_big = false) : is_big_(is_big) {
    const std::uint32_t tags = (exposed.seconds > 0) + (exposed.f_number > 0) + (exposed.iso > 0);
    constexpr std::uint32_t kIfd = 26;              // bytes of the TIFF part
    std::uint32_t data = kIfd + 2 + 12 * tags + 4;  // behind the tags
    bytes_ = is_big ? std::string("MM") : std::string("II");
    put(42, 2), put(8, 4);
    put(1, 2), put(0x8769, 2), put(4, 2), put(1, 4), put(kIfd, 4), put(0, 4);
    put(tags, 2);
    const auto rational = [&](std::uint32_t tag, double value) {
      if (!(value > 0)) return;
      put(tag, 2), put(5, 2), put(1, 4), put(data, 4);
      data += 8;
    };
    rational(0x829A, exposed.seconds);
    rational(0x829D, exposed.f_number);
    if (exposed.iso) {
      put(0x8827, 2), put(3, 2), put(1, 4);
      put(exposed.iso, 2), put(0, 2);
    }
    put(0, 4);
    for (const double value : {exposed.seconds, exposed.f_number})
      if (value > 0) put(std::uint32_t(value * 1000 + 0.5), 4), put(1000, 4);
  }

  const std::string& tiff() const { return bytes_; }

 private:
  void put(std::uint32_t value, int count) {
    for (int i = 0; i < count; ++i)
      bytes_ += char(value >> 8 * (is_big_ ? count - 1 - i : i) & 255);
  }

  std::string bytes_;
  bool is_big_;
};

/// The bytes of a gray JPEG with these tags.
inline std::string exposed_photo(int width, int height, const Exposed& exposed,
                                 bool is_big = false) {
  return gray_photo_with_exif(width, height, ExposureTiff(exposed, is_big).tiff());
}

}  // namespace gs
