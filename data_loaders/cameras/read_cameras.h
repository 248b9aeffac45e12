// SPDX-License-Identifier: Apache-2.0
// Reads the cameras of views to render, from any file or folder that has them.
#pragma once

#include <filesystem>
#include <vector>

#include "data_loaders/cameras/camera_file.h"

namespace gs {

/// Reads cameras in the coordinates of a model with that world offset, like read_cameras_json().
///
///   cameras.json       a list                       in its order
///   transforms.json    an object with "frames"      in its order; under any name
///   COLMAP model       cameras and images, .bin     by name; in the folder itself, its sparse/0 or
///                      or .txt                      its sparse
///   other folders      of a run with cameras.json, of a scene with transforms.json
///
/// No photo is needed if the file has the pictures' size. A camera with a lens becomes the pinhole
/// of its undistorted photos (undistort.h), and a panorama the cameras of its halves. Throws Error
/// that names the file and the remedy, also if there is no camera.
std::vector<NamedCamera> read_cameras(const std::filesystem::path& path, const Vec3d& world_offset);

}  // namespace gs
