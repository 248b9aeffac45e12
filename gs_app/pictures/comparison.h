// SPDX-License-Identifier: Apache-2.0
// comparison.png of a run: photo | render | error of a few views.
#pragma once

#include <cstddef>
#include <map>
#include <vector>

#include "gs_core/image.h"

namespace gs {

/// A photo and the render of the same view, of one size, three channels.
struct Comparison {
  Image8 photo, render;
};

/// Pictures of some views of an evaluation, by the number that their files have.
using ShownViews = std::map<std::size_t, Comparison>;

/// The mean absolute difference of the channels, times four: black is no error, the brightest
/// yellow a quarter of the range or more. Both pictures have the same size.
Image8 error_picture(const Image8& photo, const Image8& render);

/// The FLIP error of each pixel in the same colors: black is 0, the brightest yellow 1. Both pictures
/// have the same size.
Image8 flip_picture(const Image8& photo, const Image8& render);

/// Two pictures next to each other on white; they may differ in size.
Image8 side_by_side(const Image8& left, const Image8& right);

/// Photo, render and error side by side on white: one view in a row, or two if the pictures are
/// upright. All pictures get the same width, 320 to 640 pixels. `comparisons` is not empty.
Image8 comparison_picture(const std::vector<Comparison>& comparisons);

}  // namespace gs
