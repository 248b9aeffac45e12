// SPDX-License-Identifier: Apache-2.0
// Masks that a person paints on photos: parts of them that are not trained. They lie in the project's
// masks/, white where pixels train, in the order in which the photo's pixels are stored, so that a
// photo may be turned before and after.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "gs_app/studio/chosen_photos.h"
#include "gs_core/image.h"

namespace gs {

inline constexpr int kLongestMaskSide = 1024;  // pixels, of a mask that the page sends

/// The masks that lie beside the photos, relative to the project's folder or absolute; empty: there are
/// none. Where there are some, training uses them, and none are painted.
std::filesystem::path own_masks_of(const Project& project);

/// When the masks of photos were painted, by the photos' names.
std::map<std::string, std::int64_t> painted_masks(const Project& project);

/// The mask of a photo, as the photo is seen: upright, and turned by so many degrees. Throws
/// UsageError if it has none.
Image8 mask_as_seen(const Project& project, const std::string& photo, int degrees);

/// A mask that the page has painted, as the photo's pixels are stored; empty where it hides nothing.
/// Throws UsageError for what is no PNG of the photo's shape, and where masks lie beside the photos.
Image8 read_painted_mask(const Project& project, const std::string& photo, int degrees,
                         const std::string& png);
/// Writes what read_painted_mask() gave, whole or not at all; an empty one removes the file.
void keep_mask(const Project& project, const std::string& photo, const Image8& mask);

/// The folder behind --masks for a job on the scene with these photos: a new one, masks-JOB, with the
/// masks that were painted, as the photos of the scene lie; or masks beside the photos that it was made
/// of. Relative to the scene, or absolute where that is. Empty: there are none. Throws Error.
std::string masks_for_job(const Project& project, const std::string& scene,
                          const std::vector<ScenePhoto>& photos, int job);

/// Gives a job its photos: choose_photos() for `reconstruct chosen-JOB`, the list of those that are not
/// left out for `train`, and the masks for `train` and `doctor`, unless its words name some. Throws
/// Error.
void give_photos(const Project& project, StudioJob& job);

}  // namespace gs
