// SPDX-License-Identifier: Apache-2.0
// The picture that shows how good a run is: photo | render | error for a few views.
#pragma once

#include <vector>

#include "gs_core/image.h"

namespace gs {

/// A photo and the render of the same view, of one size, three channels.
struct Comparison {
  Image8 photo, render;
};

/// The mean absolute difference of the channels, four times enlarged: black is none, the brightest yellow a quarter of the
/// range and more. Both pictures have one size.
Image8 error_picture(const Image8& photo, const Image8& render);

/// One row per view (two views in a row where pictures stand upright), each photo, render and error side by
/// side on white. Views are brought to one width, 320 to 640 pixels. `comparisons` is not empty.
Image8 comparison_picture(const std::vector<Comparison>& comparisons);

}  // namespace gs
