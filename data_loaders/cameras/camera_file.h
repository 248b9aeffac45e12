// SPDX-License-Identifier: Apache-2.0
// cameras.json: the poses beside a trained scene, as the reference trainer (Kerbl et al. 2023)
// writes them and viewers read them.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/scene.h"
#include "gs_core/system/text/json.h"

namespace gs {

struct NamedCamera {
  std::string name;  // path of the photo relative to the images folder, without extension
  Camera camera;
};

/// The name of a lens: that of its enumerator, or "pinhole".
const char* word_of(Lens lens);

/// Writes the cameras of all views, those for testing first: a list of
///   {id, img_name, width, height,      pixels
///    position[3],                      camera center, world units
///    rotation[3][3],                   rows of world_from_cam
///    fy, fx, cx, cy}                   pixels
/// cx and cy are not in the reference's files, where the center is that of the picture. A camera with
/// a lens also has
///   lens {kind, k[6], d[3], p[2], s[4], radius[1], low[2], high[2],    CameraLens
///         turn[3], shift[3], rows[2]}                                  its motion
/// without what is 0 or infinite; other readers see its pinhole. Numbers
/// have as many digits as their float needs. Positions have the scene's world offset taken off,
/// like those of the PLY beside it. The file exists whole or not at all. Throws Error if it cannot
/// be written.
void write_cameras_json(const std::filesystem::path& path, const Scene& scene);

/// The same for cameras with their names unchanged.
void write_cameras_json(const std::filesystem::path& path, const std::vector<NamedCamera>& cameras);

/// Reads such a list, in its order. Without cx or cy the center is that of the picture; other keys
/// are ignored, and without lens the camera is a pinhole. `world_offset` is that of the model to be
/// viewed (Scene). If most positions are nearer to it than to 0, they are in the photos' own
/// coordinates, and it is taken off in double precision. Throws Error that names file, camera and
/// key for anything that is not a camera.
std::vector<NamedCamera> read_cameras_json(const std::filesystem::path& path,
                                           const Vec3d& world_offset = Vec3d(0.0));

/// The same for a list that is part of a file, which errors name.
std::vector<NamedCamera> cameras_of_json(const SortedJson& list, const std::filesystem::path& path,
                                         const Vec3d& world_offset);

}  // namespace gs
