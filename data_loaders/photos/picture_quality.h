// SPDX-License-Identifier: Apache-2.0
// How sharp and how bright photos are, and which stand apart from the others.
#pragma once

#include <cstddef>
#include <vector>

#include "gs_core/image.h"

namespace gs {

struct PictureQuality {
  double sharpness = 0;   // variance of the Laplacian of the luma, at most kQualityWidth pixels wide
  double brightness = 0;  // mean luma, 0..255
};
inline constexpr int kQualityWidth = 640;

/// `photo` is (height, width, 3).
PictureQuality quality_of(const Image8& photo);

struct QualityOutliers {
  std::vector<std::size_t> blurred, odd_exposure;  // ascending
};
/// Photos whose sharpness is less than a quarter of the median, or whose brightness is off by more than a factor of two, and
/// each of them by more than 3.5 times the usual deviation from the median (of logarithms). None among fewer than five.
QualityOutliers outliers_of(const std::vector<PictureQuality>& qualities);

}  // namespace gs
