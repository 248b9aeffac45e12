// SPDX-License-Identifier: Apache-2.0
// The files in a folder of photos and below it; used by reconstruct/*.cpp only.
#pragma once

#include <filesystem>
#include <vector>

namespace gs {

/// The files in a folder, and below it where `deep`; sorted. Hidden ones, scenes and runs of gemsplat
/// and everything below `without` are left out. Throws AccessError if a folder cannot be listed: a
/// scene of a part of the photos would look whole.
std::vector<std::filesystem::path> files_in(const std::filesystem::path& folder, bool deep,
                                            const std::filesystem::path& without = {});

/// The folder that the photos' names are relative to: the folder itself, or its images/ if no photo
/// lies directly in the folder and images/ has some, in it or below.
std::filesystem::path photo_root(const std::filesystem::path& folder);

/// Whether a file below `root` is a photo of the scene: not one of masks/ or depth/.
bool is_scene_photo(const std::filesystem::path& file, const std::filesystem::path& root);

}  // namespace gs
