// SPDX-License-Identifier: Apache-2.0
// Reads maps: pictures whose values are numbers, not colors.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "data_loaders/photos/photos.h"
#include "gs_core/image.h"

namespace gs {

/// What a map is called in messages, and which channels are read of a file that has so many.
struct MapKind {
  const char *noun, *remedy;
  /// The first one, and their number.
  std::pair<int, int> (*channels)(const std::vector<std::string>& names);
};
extern const MapKind kDepthMap, kNormalMap;

/// Those channels of a file.
struct MapFile {
  ImageF values;           // (height, width, channels) as they stand in the file
  bool has_steps = false;  // they are integers
  int bits = 16;           // of a value
};

/// Reads a depth map, (height, width, 1): gray integers of 8 or 16 bits (PNG, TIFF, PGM), or floats
/// (EXR, TIFF). Of an EXR with several channels it takes the one named Z, depth or Y, with any layer
/// before it; three equal channels count as gray. A build without OpenImageIO reads PNG. Throws Error
/// that names the file, also for a picture in colors.
MapFile read_depth_file(const std::filesystem::path& path);

/// Reads normals, (height, width, 3), of length 1, or 0 where the file says nothing: where its vector
/// is not of a length from 0.5 to 1.5, and where its alpha is 0. Integers stand for 2 c - 1 with c
/// from 0 to 1. Of an EXR with layers it takes the channels X, Y and Z of the one named Normal or N.
/// Throws Error likewise, also for a file of fewer than three channels.
ImageF read_normal_file(const std::filesystem::path& path);

/// The size of a map, from its header. Throws Error likewise.
PhotoSize read_map_size(const MapKind& kind, const std::filesystem::path& path);

/// Throws Error: cannot read NOUN FILE: `what`; `remedy`.
[[noreturn]] void cannot_read_map(const MapKind& kind, const std::filesystem::path& path,
                                  const std::string& what);

}  // namespace gs
