// SPDX-License-Identifier: Apache-2.0
// blocks.json: what a partition has decided, for the merge and for other programs.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "gs_core/geometry/cut_tree.h"

namespace gs {

/// One block. Paths are relative to the folder of the file.
struct BlockEntry {
  std::string name;    // block0, block1, ...
  std::string config;  // its settings, over those that all blocks share
  std::string run;     // where the experiment of the partition trains it
  std::string region;  // density.region of the run
  std::size_t train_photos = 0, test_photos = 0, points = 0, points_outside = 0;
};

struct BlocksFile {
  std::filesystem::path file;  // where it was read from, or is written to
  std::string scene;           // its folder, absolute
  Vec3d up{0.0, -1.0, 0.0};
  CutTree tree;  // in the coordinates of the photos' poses; part i is that of block i
  std::vector<BlockEntry> blocks;

  std::filesystem::path folder() const { return file.parent_path(); }
};

/// The text of the file.
std::string blocks_json(const BlocksFile& blocks);

/// Whether this is blocks.json or a folder that holds one.
bool is_partition(const std::filesystem::path& file_or_folder);

/// Reads blocks.json, or the one in a folder. Throws Error that names the file and a remedy.
BlocksFile read_blocks(const std::filesystem::path& file_or_folder);

}  // namespace gs
