// SPDX-License-Identifier: Apache-2.0
// Camera poses of other programs beside photos, which gemsplat sees and does not read.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace gs {

struct ForeignCameras {
  std::filesystem::path file;
  std::string program;
  std::string way;  // how that program gives a scene that gemsplat reads
};

/// The first such file in a folder and below it, by its name and its first bytes: a project of
/// Metashape or RealityCapture. What foreign_scene.h reads is not among them.
std::optional<ForeignCameras> find_foreign_cameras(const std::filesystem::path& folder);

/// "cameras.xml holds camera poses of Metashape, which gemsplat does not read: ...", with the way,
/// and the command that lets COLMAP place the photos anew.
std::string text_of(const ForeignCameras& cameras, const std::filesystem::path& folder);

}  // namespace gs
