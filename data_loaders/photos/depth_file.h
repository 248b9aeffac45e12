// SPDX-License-Identifier: Apache-2.0
// Reads depth maps: gray pictures whose values are numbers, not colors.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "data_loaders/photos/photos.h"
#include "gs_core/image.h"

namespace gs {

struct DepthFile {
  ImageF values;           // (height, width, 1) as they stand in the file
  bool has_steps = false;  // they are integers: steps of a unit that the file does not tell
  int bits = 16;           // of a value
};

/// Reads a depth map: gray integers of 8 or 16 bits (PNG, TIFF, PGM), or floats (EXR, TIFF). Of an
/// EXR with several channels it takes the one named Z, depth or Y, with any layer before it; three
/// equal channels count as gray. A build without OpenImageIO reads PNG. Throws Error that names the
/// file, also for a picture in colors.
DepthFile read_depth_file(const std::filesystem::path& path);

/// Its size, from its header. Throws Error likewise.
PhotoSize read_depth_size(const std::filesystem::path& path);

/// Takes gray values of (height, width, channels) into `depth`, which has its size. Throws Error
/// where the channels of a pixel differ. For decoders.
void take_gray(const std::filesystem::path& path, const std::vector<float>& values, int channels,
               ImageF& depth);

/// Throws Error: cannot read depth map FILE: `what`.
[[noreturn]] void cannot_read_depth(const std::filesystem::path& path, const std::string& what);

}  // namespace gs
