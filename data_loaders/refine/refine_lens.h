// SPDX-License-Identifier: Apache-2.0
// Finds the camera of another model whose pictures are nearest to those of a given camera.
#pragma once

#include "data_loaders/colmap/colmap_model.h"

namespace gs {

/// A camera that replaces another, and how far its pixels are off.
struct FittedCamera {
  ColmapCamera camera;
  // Pixels, over a grid of the whole picture; infinite where the lens folds back.
  double mean_error = 0, max_error = 0;
  double unseen_share = 0;  // of the picture: rays at 90 degrees or more from the axis
};

/// Fits focal lengths, principal point and coefficients of `target` (PINHOLE or OPENCV) by least
/// squares, so that the rays of a grid of pixels land on these pixels again. Throws Error as
/// lens_camera() does; its messages name `photo`. Only where can_refine().
FittedCamera fit_camera(const ColmapCamera& camera, CameraModel target, const std::string& photo);

}  // namespace gs
