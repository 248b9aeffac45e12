// SPDX-License-Identifier: Apache-2.0
// Pixels of a photo at positions between its pixels, by bicubic interpolation.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "gs_core/image.h"

namespace gs {

/// For each pixel of some rows of a new picture, where the photo has it. The center of the photo's
/// first pixel is (0, 0).
struct PhotoPositions {
  int width, height;
  std::vector<float> x, y;  // (height, width)

  PhotoPositions(int width, int height)
      : width(width), height(height), x(std::size_t(width) * height), y(x.size()) {}
};

/// Writes the photo's channels at all positions to `target`, (height, width, channels).
///
/// Each direction has the four weights of Keys 1981 (cubic convolution) with a = -0.75, as OpenCV
/// has. Beyond its border the photo continues with its border pixels.
void resample_bicubic(const Image8& photo, const PhotoPositions& positions, std::uint8_t* target);

/// The same through OpenCV, which rounds positions to 1/32 of a pixel and takes a fraction of the
/// time; in a build without OpenCV it is resample_bicubic(). No side may be longer than
/// kLongestResampled.
void resample(const Image8& photo, const PhotoPositions& positions, std::uint8_t* target);

/// The library that resamples, with its version: another one may give other bytes.
std::string resampler_name();

inline constexpr int kLongestResampled = 32766;  // pixels; cv::remap takes no more

}  // namespace gs
