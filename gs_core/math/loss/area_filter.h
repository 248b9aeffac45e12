// SPDX-License-Identifier: Apache-2.0
// Photos that are reduced by a whole factor while training begins: their camera and their values.
//
// Pixel (x, y) of a reduced photo is the mean of the factor x factor pixels from (factor x, factor
// y) on. Columns and rows that fill no whole block, factor - 1 at most, at the right and at the
// bottom, are left out, so that each pixel shows what its camera sees there. Everything is computed
// with integers: the CPU and the GPU have the same bytes.
#pragma once

#include <cstdint>

#include "gs_core/camera.h"

namespace gs {

/// The camera of a photo that is reduced `factor` times; photo and factor are such that a pixel is
/// left. A point at (u, v) in the photo is at (u, v) / factor.
template <class T>
PinholeCamera<T> reduced(PinholeCamera<T> camera, int factor) {
  camera.width /= factor;
  camera.height /= factor;
  camera.fx /= T(factor);
  camera.fy /= T(factor);
  camera.cx /= T(factor);
  camera.cy /= T(factor);
  return camera;
}

/// A photo as bytes in rows, and its mask.
struct PhotoBytes {
  const std::uint8_t* photo;  // (height, width, 3)
  const std::uint8_t* mask;   // (height, width); null: every pixel trains
};

GS_HD std::uint8_t rounded_mean(std::uint32_t sum, std::uint32_t count) {
  return std::uint8_t((sum + count / 2) / count);
}

/// Channel c of pixel (x, y) of the reduced photo. Pixels count by their masks:
///
///   Y' = sum m Y / sum m,  m' = mean m   =>   m' Y' = mean(m Y)
///
/// so that the mean of what the loss compares (photo_weight.h) is what it compares at the mean.
///
/// width   of the photo, in pixels
/// factor  at most kMostReduction
GS_HD std::uint8_t reduced_value(const PhotoBytes& from, int width, int factor, int x, int y,
                                 int c) {
  std::uint32_t sum = 0, weighted = 0, weight = 0;
  for (int row = y * factor; row < (y + 1) * factor; ++row)
    for (int column = x * factor; column < (x + 1) * factor; ++column) {
      const std::size_t pixel = std::size_t(row) * std::size_t(width) + std::size_t(column);
      const std::uint32_t value = from.photo[3 * pixel + std::size_t(c)];
      const std::uint32_t m = from.mask ? from.mask[pixel] : 0;
      sum += value;
      weighted += m * value;
      weight += m;
    }
  return weight > 0 ? rounded_mean(weighted, weight)
                    : rounded_mean(sum, std::uint32_t(factor * factor));
}

/// The mask at pixel (x, y) of the reduced photo. from.mask is not null.
GS_HD std::uint8_t reduced_mask(const PhotoBytes& from, int width, int factor, int x, int y) {
  std::uint32_t sum = 0;
  for (int row = y * factor; row < (y + 1) * factor; ++row)
    for (int column = x * factor; column < (x + 1) * factor; ++column)
      sum += from.mask[std::size_t(row) * std::size_t(width) + std::size_t(column)];
  return rounded_mean(sum, std::uint32_t(factor * factor));
}

/// The value of a depth map at pixel (x, y) of the reduced photo: the one nearest to the center of
/// its block. A mean over the edge of an object would be the depth of nothing.
GS_HD float reduced_depth(const float* depth, int width, int factor, int x, int y) {
  const int row = y * factor + factor / 2, column = x * factor + factor / 2;
  return depth[std::size_t(row) * std::size_t(width) + std::size_t(column)];
}

}  // namespace gs
