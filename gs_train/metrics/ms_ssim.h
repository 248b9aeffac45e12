// SPDX-License-Identifier: Apache-2.0
// Multi-scale structural similarity (Wang, Simoncelli, Bovik 2003).
#pragma once

#include "gs_train/metrics/compared_pictures.h"

namespace gs {

/// MS-SSIM, 1 for identical pictures; the mean over channels. Windows are those of SSIM, 11x11 and
/// Gaussian, and only those that lie within the picture count, at each of five scales. Pictures
/// whose shorter side is below 176 pixels have fewer scales, with exponents that add up to the same
/// sum; one below 11 pixels has a smaller window. A window counts as much as the mean of the weight
/// in it; at least one weight is above 0.
double ms_ssim(const ComparedPictures& pictures);

}  // namespace gs
