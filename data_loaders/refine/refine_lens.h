// SPDX-License-Identifier: Apache-2.0
// The camera of another model that shows the same pictures as nearly as it can.
#pragma once

#include "data_loaders/colmap/colmap_model.h"

namespace gs {

/// A camera that stands for another, and by how much it is off.
struct FittedCamera {
  ColmapCamera camera;
  double mean_error = 0, max_error = 0;  // pixels, over a grid of the whole picture; infinite where the lens folds back
  double unseen_share = 0;               // of the picture: rays that no pinhole in front of a lens can have
};

/// Fits focal lengths, principal point and coefficients of `target` (PINHOLE or OPENCV) so that the rays of a grid
/// of pixels land on these pixels again, by least squares. Throws Error like lens_camera(); `photo` is for
/// its messages. Only where can_refine().
FittedCamera fit_camera(const ColmapCamera& camera, CameraModel target, const std::string& photo);

}  // namespace gs
