// SPDX-License-Identifier: Apache-2.0
// FLIP for pictures of limited range (Andersson, Nilsson, Akenine-Moller, Oskarsson, Astrom,
// Fairchild 2020: "FLIP: A Difference Evaluator for Alternating Images"): the difference that
// somebody sees who alternates between render and photo. The observer is the paper's: 0.7 m in front
// of a screen that is 0.7 m and 3840 pixels wide, 67 pixels per degree.
#pragma once

#include "gs_eval/compared_pictures.h"

namespace gs {

/// The mean error over pixels, each with its weight; 0 for identical pictures, at most 1. At least
/// one weight is above 0.
double flip(const ComparedPictures& pictures);

/// The error at each pixel, 0 to 1: (height, width, 1). Weights are not applied.
ImageF flip_map(const ImageF& render, const ImageF& photo);

}  // namespace gs
