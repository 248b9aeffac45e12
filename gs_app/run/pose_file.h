// SPDX-License-Identifier: Apache-2.0
// poses.json: where a run has found that its training photos were taken, for people and for
// `gemsplat eval`.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "gs_core/scene.h"

namespace gs {

struct RefinedPose {
  Mat3<float> cam_from_world_rotation;
  Vec3f cam_from_world_translation;  // world units
};
/// By the names of training photos.
using RefinedPoses = std::map<std::string, RefinedPose>;

/// {"degrees", "shift", "photos": {name: {"rotation", "translation", "degrees", "shift"}, ...}}:
/// cam_from_world as three rows and a vector, in the coordinates of cameras.json; the angle between
/// it and the given pose, and the distance between the centers in world units. Above them the root
/// mean squares of all photos. Written whole or not at all. Throws Error.
///
/// refined  (train_views) their cameras now
void write_poses(const std::filesystem::path& path, const std::vector<View>& train_views,
                 const std::vector<Camera>& refined);

/// Throws Error that names the file, the photo and a remedy where a rotation is none.
RefinedPoses read_poses(const std::filesystem::path& path);

/// Gives the training views their poses. Views that are not listed keep theirs.
void apply_poses(const RefinedPoses& poses, Scene& scene);

}  // namespace gs
