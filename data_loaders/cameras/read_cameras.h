// SPDX-License-Identifier: Apache-2.0
// Cameras to look from, out of whatever file or folder has them.
#pragma once

#include <filesystem>
#include <vector>

#include "data_loaders/cameras/camera_file.h"

namespace gs {

/// Reads cameras in the coordinates of a model with that world offset (read_cameras_json() says how).
///
///   cameras.json       a list                     in its order
///   transforms.json    an object with "frames"    in its order; under any name
///   COLMAP model       cameras and images, .bin or .txt, in the folder itself, its sparse/0 or its sparse    by name
///   other folders      that of a run with its cameras.json; of a scene with transforms.json
///
/// Of the last three no photo is needed where the file tells its size. Lenses become the pinhole that photos are
/// undistorted to (undistort.h). Throws Error that names the file and the remedy; also where there is no camera.
std::vector<NamedCamera> read_cameras(const std::filesystem::path& path, const Vec3d& world_offset);

}  // namespace gs
