// SPDX-License-Identifier: Apache-2.0
// The key frames of a camera path, as the viewer's path editor writes them for `render --path
// FILE`.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/cameras/camera_file.h"

namespace gs {

struct KeyFrames {
  std::vector<NamedCamera> keys;  // at least two; their times are 0 if the file has none
  bool is_closed = false;         // the path returns to the first key
  std::string pace = "even";      // or "keys": PathRequest
  double seconds = 0;             // of the whole path
};

/// Reads {"format": "gemsplat key frames", "version": 1, "closed", "pace", "seconds", "keys"}; the
/// keys are a list as in cameras.json. Throws Error that names the file and what is wrong with it,
/// also if it is of a newer version.
KeyFrames read_key_frames(const std::filesystem::path& file, const Vec3d& world_offset);

}  // namespace gs
