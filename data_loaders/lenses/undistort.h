// SPDX-License-Identifier: Apache-2.0
// Turns a photo taken through a lens into the photo of a pinhole camera, which training expects.
#pragma once

#include <string>

#include "data_loaders/lenses/lens.h"
#include "gs_core/image.h"

namespace gs {

/// The pinhole camera of the undistorted photo. It keeps the focal lengths, so that the center
/// stays as sharp as it was, and the principal point's relative position; it is as large as it can
/// be while every pixel lies inside the photo, at most kMostEnlargement times the photo's size.
/// `colmap image_undistorter` does the same by default. A camera without a lens is returned as it
/// is. `photo` names the photo in errors. Throws Error for coefficients that leave no picture, and
/// for a pinhole with a side kWidestHalfField or more from the axis.
PinholeCamera<double> undistorted_pinhole(const LensCamera& camera, const std::string& photo);

/// Whether the photo is better trained on through its lens: undistorted_pinhole() refuses the lens
/// because it sees too far from the axis, and for no other reason, or the lens is a fisheye of whose
/// pixels the pinhole shows less than kLeastKept.
bool is_too_wide_for_pinhole(const LensCamera& camera);

inline constexpr double kMostEnlargement = 2;   // COLMAP's max_scale, a limit for wide lenses
inline constexpr double kLeastKept = 0.8;       // a fisheye of 64 degrees to each side keeps 0.84
inline constexpr double kWidestHalfField = 75;  // degrees; a pinhole stretches 1 / cos^2 = 15 times

/// The photo as `pinhole` sees it. `image` has the size of `camera`. `photo` names the photo in
/// errors. Throws Error for photos with a side longer than kLongestResampled.
///
/// Resampled bicubically: on the 25 photos of a 360 x 640 phone video, bilinear resampling
/// (COLMAP's) leaves 64 % of the energy of the Laplacian of the photos undistorted at 1080 x 1920,
/// bicubic 103 %, Lanczos 113 %, at the same PSNR against them (39.3, 39.2, 39.1 dB).
Image8 undistorted_photo(const Image8& image, const LensCamera& camera,
                         const PinholeCamera<double>& pinhole, const std::string& photo);

}  // namespace gs
