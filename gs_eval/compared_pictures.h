// SPDX-License-Identifier: Apache-2.0
// A render and a photo, as flip() and Lpips compare them.
#pragma once

#include "gs_core/image.h"

namespace gs {

/// Two pictures of the same size with three channels, values in [0, 1] of display sRGB. Where
/// `weight` is not empty, both are already multiplied by it.
struct ComparedPictures {
  ImageF render, photo;  // (height, width, 3)
  ImageF weight;         // (height, width, 1), in [0, 1]; empty where every pixel counts fully

  double weight_at(int x, int y) const { return weight.empty() ? 1.0 : double(weight.at(x, y, 0)); }
};

}  // namespace gs
