// SPDX-License-Identifier: Apache-2.0
// Writes a COLMAP model with PINHOLE or OPENCV cameras, for programs that do not know its own
// lenses.
#pragma once

#include <filesystem>
#include <vector>

#include "data_loaders/refine/refine_lens.h"

namespace gs {

/// Writes the model in `from` to the folder `to`, in the same encoding, with each camera replaced
/// by the nearest one of `target`. Photos and poses stay the same, so images, points, rigs and
/// frames are copied byte by byte. Returns the fits in the order of the camera ids.
/// Throws UsageError where `to` exists and is not empty. Throws Error before anything is written
/// where a camera is off by more than `max_error` pixels anywhere, and in a build without Ceres;
/// also where files cannot be read or written.
std::vector<FittedCamera> convert_cameras(const std::filesystem::path& from,
                                          const std::filesystem::path& to, CameraModel target,
                                          double max_error);

}  // namespace gs
