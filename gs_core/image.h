// SPDX-License-Identifier: Apache-2.0
// Pictures in host memory: row-major, channels interleaved.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace gs {

/// A picture of `width` x `height` pixels with `channels` values each; element (x, y, c) lies at
/// ((y * width) + x) * channels + c. Row 0 is the top row.
template <class T>
struct Image {
  int width = 0, height = 0, channels = 0;
  std::vector<T> pixels;  // (height, width, channels)

  Image() = default;
  Image(int width, int height, int channels, T fill = T{})
      : width(width), height(height), channels(channels),
        pixels(std::size_t(width) * height * channels, fill) {}

  bool empty() const { return pixels.empty(); }
  T& at(int x, int y, int c) { return pixels[(std::size_t(y) * width + x) * channels + c]; }
  const T& at(int x, int y, int c) const {
    return pixels[(std::size_t(y) * width + x) * channels + c];
  }
};

using Image8 = Image<std::uint8_t>;  // 0..255, display sRGB as stored in the file
using ImageF = Image<float>;         // 0..1, display sRGB unless said otherwise

/// byte * kPerByte is the value in 0..1 of a photo's byte. It is rounded once, on the CPU as on the
/// GPU, so that both have the same bits.
inline constexpr float kPerByte = 1.0f / 255.0f;

/// 0..1 to 0..255, rounded; values outside are clamped, NaN becomes 0.
inline Image8 to_image8(const ImageF& image) {
  Image8 result(image.width, image.height, image.channels);
  std::transform(image.pixels.begin(), image.pixels.end(), result.pixels.begin(), [](float value) {
    return value > 0 ? std::uint8_t(std::min(value, 1.0f) * 255.0f + 0.5f) : std::uint8_t(0);
  });
  return result;
}

}  // namespace gs
