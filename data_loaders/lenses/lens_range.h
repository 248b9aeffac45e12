// SPDX-License-Identifier: Apache-2.0
// Cameras that see through their lens, so that photos train as they were taken: how far the lens's
// formula counts, and which pixels it explains.
#pragma once

#include "data_loaders/lenses/lens.h"
#include "gs_core/config/config_words.h"
#include "gs_core/image.h"

namespace gs {

/// The photo's camera with its lens and the range of the lens. The formula counts until it folds,
/// until a step away from the axis moves the pixel by less than kSlowestLens of what it does at the
/// center, and to the picture's last corner: nothing beyond was ever measured.
/// Throws Error that names the photo for a lens that does not count at its own center.
PinholeCamera<double> camera_with_lens(const LensCamera& camera, const std::string& photo);

inline constexpr double kSlowestLens = 0.25;
inline constexpr double kWidestPerspective = 85;  // degrees; the perspective chart ends at 90

/// The camera that a photo trains with. LensUse::automatic undistorts it unless
/// is_too_wide_for_pinhole(). Throws Error as the other two do.
PinholeCamera<double> trained_camera(const LensCamera& camera, LensUse use,
                                     const std::string& photo);

/// The camera of a photo that was taken while the camera moved, row by row, without the motion: it
/// trains through its lens, or through one without coefficients. Throws Error as camera_with_lens()
/// does, and where LensUse::undistort would mix the rows of a photo, or a panorama would.
PinholeCamera<double> row_by_row_camera(const LensCamera& camera, LensUse use,
                                        const std::string& photo);

/// Whether every pixel of the photo is one that its lens explains: the others show what no ray of
/// the model reaches. `camera` is the photo's, `seen` the same with its lens.
bool explains_all_pixels(const LensCamera& camera, const CameraLens<double>& seen);

/// 255 for the pixels that the lens explains, (height, width, 1).
Image8 mask_of_lens(const LensCamera& camera, const CameraLens<double>& seen);

}  // namespace gs
