// SPDX-License-Identifier: Apache-2.0
// Streamed SOG, version 1 (PlayCanvas): a folder with lod-meta.json, and folders LEVEL_NUMBER that
// hold SOG files (formats/sog). A viewer draws each leaf of the tree at one of its levels.
//
//   {"version": 1, "asset": {"generator"}, "count": of all levels, "counts": [of each level],
//    "lodLevels": L, "lodErrors": false, "filenames": ["0_0/meta.json", ...], "tree": NODE}
//   NODE  {"bound": {"min": [3], "max": [3]}, "children": [NODE, NODE]}
//   leaf  {"bound", "lods": {"0": {"file": of filenames, "offset": first row, "count": rows}, ...}}
//
// Level 0 is the finest. A file holds rows of one level, leaf after leaf. Bounds are those of
// ellipsoids of one standard deviation. Axes and units are the PLY's.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "gs_model/lod/lod_tree.h"

namespace gs {

/// The one name that viewers know.
inline constexpr const char* kLodMeta = "lod-meta.json";
/// The same levels as export --lod writes them beside it, for Spark (rad.h).
inline constexpr const char* kLodRad = "model.rad";

struct StreamedSogOptions {
  int sh_degree = kMaxShDegree;  // of the files, 0..3
  bool antialiased = false;
  // Gaussians of a file at most, unless a leaf has more. With more, fewer bytes; a viewer loads
  // whole files.
  std::size_t file_rows = 262'144;
};

/// What was written for a level.
struct StreamedLevel {
  std::size_t gaussians = 0;
  std::uint64_t bytes = 0;  // of its folders
};

/// Writes the folder, lod-meta.json last. The same tree gives the same bytes. Rotations must have
/// length 1 (finite_model()). Throws Error where this build lacks libwebp, and where a file cannot
/// be written.
std::vector<StreamedLevel> write_streamed_sog(const std::filesystem::path& folder,
                                              const LodTree& tree,
                                              const StreamedSogOptions& options);

/// Reads one level of a lod-meta.json: of each leaf the coarsest level up to `level`, or, where it
/// has none, the finest. 0 is the model itself. Rows of "environment", which has no levels, are
/// always read. No file outside of the folder is read. Throws Error, with the file and a remedy,
/// for damaged files and other versions, and where "lodLevels" says that there is no such level.
GaussianModel read_streamed_sog(const std::filesystem::path& lod_meta, int level);
inline GaussianModel read_streamed_sog(const std::filesystem::path& lod_meta) {
  return read_streamed_sog(lod_meta, 0);
}

}  // namespace gs
