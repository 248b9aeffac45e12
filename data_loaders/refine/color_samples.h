// SPDX-License-Identifier: Apache-2.0
// The colors that photos give to the points they show. Exposures are solved from these.
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

/// Bilinear samples of a view's photo where points lie in it. The photo is first made smaller, to
/// `kSampledSide` pixels along its longer side.
/// photo   index that the samples get
/// seen    indices in `points` of those that the photo is known to show
/// Points behind the camera or outside the picture are left out, and so are colors with a channel
/// near black or white, where the sensor saturates.
std::vector<ColorSample> sample_colors(const View& view, std::uint32_t photo,
                                       const std::vector<ScenePoint>& points,
                                       const std::vector<std::uint32_t>& seen);

/// Pixels. A sample is then the mean over 1/600 of the picture's side, so that a pixel of parallax
/// or of blur changes little.
inline constexpr int kSampledSide = 600;

}  // namespace gs
