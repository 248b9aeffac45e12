// SPDX-License-Identifier: Apache-2.0
// A COLMAP model with cameras of another model: for programs that do not know the original's lenses.
#pragma once

#include <filesystem>
#include <vector>

#include "data_loaders/refine/refine_lens.h"

namespace gs {

/// Writes the model in `from` to the folder `to`, in the same encoding, with each camera fitted by one of `target`; images,
/// points, rigs and frames are copied byte by byte, for photos and poses stay the same. Returns the fits, by camera
/// id. Throws UsageError where `to` exists and is not empty; Error where a camera cannot be fitted to `max_error` pixels
/// everywhere, before anything is written; where files cannot be read or written; in a build without Ceres.
std::vector<FittedCamera> convert_cameras(const std::filesystem::path& from,
                                          const std::filesystem::path& to, CameraModel target,
                                          double max_error);

}  // namespace gs
