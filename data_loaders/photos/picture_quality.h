// SPDX-License-Identifier: Apache-2.0
// Sharpness and brightness of photos, and those that differ much from the others.
#pragma once

#include <cstddef>
#include <vector>

#include "gs_core/image.h"

namespace gs {

struct PictureQuality {
  double sharpness = 0;   // variance of the Laplacian of the luma, at kQualityWidth pixels or less
  double brightness = 0;  // mean luma, 0..255
};
inline constexpr int kQualityWidth = 640;

/// `photo` is (height, width, 3).
PictureQuality quality_of(const Image8& photo);

struct QualityOutliers {
  std::vector<std::size_t> blurred, odd_exposure;  // ascending
};
/// Photos with a sharpness below a quarter of the median, or a brightness off by more than a factor
/// of two; in both cases also by more than 3.5 times the usual deviation of the logarithms from
/// their median. None among fewer than five photos.
QualityOutliers outliers_of(const std::vector<PictureQuality>& qualities);

}  // namespace gs
