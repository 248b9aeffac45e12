// SPDX-License-Identifier: Apache-2.0
// A scene that was reconstructed anew, with more photos say, has coordinates of its own. The photos
// that both reconstructions have bring a model of the old one into the new one.
#pragma once

#include <optional>
#include <vector>

#include "data_loaders/cameras/camera_file.h"
#include "gs_core/scene.h"
#include "gs_model/edit/model_transform.h"

namespace gs {

/// Where two sets of cameras have the same names.
struct SharedCameras {
  std::size_t count = 0;
  bool coincide = false;     // they stand and look as they did, up to 1 % of their spread
  ModelTransform transform;  // else: brings the first set into the coordinates of the second
  double error = 0;          // then the median distance is left, as a share of the spread
};

/// Compares the cameras of a model with those of a scene. Rotations give the turn, centers the
/// scale and the shift. Empty where fewer than three names are shared, or where all of them stand in one
/// place.
///
/// offset   added to the positions of `cameras`; the scene's are in its own coordinates
std::optional<SharedCameras> shared_cameras(const std::vector<NamedCamera>& cameras,
                                            const Vec3d& offset, const Scene& scene);

}  // namespace gs
