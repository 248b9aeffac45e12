// SPDX-License-Identifier: Apache-2.0
// Which photos of a project its jobs get, and how: those that are not left out, turned ones as
// copies. No photo is changed.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_app/studio/project.h"

namespace gs {

/// The folder that the names of photos are relative to.
std::filesystem::path photo_folder_of(const Project& project);
/// These names, sorted; none of masks, depth maps or normal maps that lie beside the photos.
std::vector<std::string> photos_of(const Project& project);

/// Whether a person may turn photos by so many degrees: 0, 90, 180 or 270, clockwise.
bool is_turn(int degrees);

/// Writes the copies of turned photos that are not there yet, on all threads. Throws Error.
void make_turned_copies(const Project& project);
/// Makes chosen-JOB/, with links to the photos that are not left out, and to the copies of turned ones
/// in place of these. Throws Error.
void choose_photos(const Project& project, int job);

/// A photo of a scene with cameras.
struct ScenePhoto {
  std::string name;   // in the scene
  std::string photo;  // in the project; empty: none of its photos, such as a frame of a video
  bool has_own_mask;  // that the scene's file of cameras names
};
/// The photos of a scene whose folder is relative to the project's, or absolute. Throws Error.
std::vector<ScenePhoto> photos_of_scene(const Project& project, const std::string& scene);
/// Whether the scene is the folder of photos itself, and not one that `reconstruct` has made.
bool is_own_scene(const Project& project, const std::string& scene);

/// Writes photos.txt: the photos of the scene that are not left out. False if all of them are in.
/// Throws Error.
bool write_chosen_list(const Project& project, const std::vector<ScenePhoto>& photos);

}  // namespace gs
