// SPDX-License-Identifier: Apache-2.0
// Colors of a picture at places between the middles of its pixels.
#pragma once

#include <algorithm>

#include "gs_core/image.h"
#include "gs_core/types.h"

namespace gs {

/// Bilinear between the four nearest pixels of a picture with three channels; beyond its border as
/// at it. `at`: pixels, with middles at halves. Returns 0 to 255.
inline Vec3f between_pixels(const Image8& picture, const Vec2f& at) {
  const auto split = [](float place, int size, int& low, int& high) {
    const float pixel = std::clamp(place - 0.5f, 0.0f, float(size - 1));
    low = int(pixel);
    high = std::min(low + 1, size - 1);
    return pixel - float(low);
  };
  int x0, x1, y0, y1;
  const float s = split(at.x, picture.width, x0, x1);
  const float t = split(at.y, picture.height, y0, y1);
  Vec3f result;
  for (int c = 0; c < 3; ++c)
    result[c] =
        (1 - t) * ((1 - s) * float(picture.at(x0, y0, c)) + s * float(picture.at(x1, y0, c))) +
        t * ((1 - s) * float(picture.at(x0, y1, c)) + s * float(picture.at(x1, y1, c)));
  return result;
}

}  // namespace gs
