// SPDX-License-Identifier: Apache-2.0
// What color each photo gives to the points that it shows: the data that exposures are solved from.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/scene.h"

namespace gs {

/// The color of one point in one photo.
struct ColorSample {
  std::uint32_t photo = 0, point = 0;  // indices
  Vec3f color{0};                      // display sRGB, in (0, 1)
};

/// Bilinear samples of a view's photo, made smaller to `kSampledSide` pixels along its longer side, where the points lie
/// in it. `seen` holds the indices in `points` of those that the photo is known to show. Left out are points behind
/// the camera or outside the picture, and those with a channel near black or near white, where the sensor was at its
/// end. The samples' `photo` is `photo`.
std::vector<ColorSample> sample_colors(const View& view, std::uint32_t photo,
                                       const std::vector<ScenePoint>& points,
                                       const std::vector<std::uint32_t>& seen);

/// Pixels: each sample is the mean of some 1/600 of the picture's side, so that a pixel more or less of parallax or of
/// sharpness changes little.
inline constexpr int kSampledSide = 600;

}  // namespace gs
