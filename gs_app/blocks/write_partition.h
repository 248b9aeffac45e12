// SPDX-License-Identifier: Apache-2.0
// The folder of a partition: a config for each block, and an experiment that trains all of them.
//
//   blocks.json    the cuts and the blocks, for the merge
//   blocks.toml    the experiment: `gemsplat experiment blocks.toml`
//   shared.toml    the settings that all blocks share, whole
//   block0.toml    base = "shared.toml", and what is the block's own
//   block0.txt     names of its photos, which stay where they are
#pragma once

#include <filesystem>

#include "gs_app/blocks/blocks_file.h"
#include "gs_app/blocks/partition.h"
#include "gs_core/config/config.h"

namespace gs {

/// The settings that all blocks share, of those that a user gives. Blocks that start from a model
/// (model.start_from) keep what their photos do not see, such as a part of the sky that only photos
/// of other blocks show: opacities are not reset, and no rule removes Gaussians because they were
/// not seen.
Config settings_of_all_blocks(Config config);

/// The settings of a block's run: those of `shared`, with its photos (dataset.photo_list is left to
/// the caller) and its region. A limit of Gaussians becomes the block's share of it: as much of the
/// limit as the region has of the scene's points, and one for each point outside.
Config settings_of_block(Config shared, const Partition& partition, const Block& block);

/// Throws UsageError where the files of a partition could not name the folder or what the settings
/// name. Writes nothing.
void check_partition(const std::filesystem::path& folder, Config shared);

/// Writes the folder, which is new or empty. `shared` is of settings_of_all_blocks(); its paths are
/// made absolute. Throws Error, and UsageError as check_partition().
BlocksFile write_partition(const std::filesystem::path& folder, const Partition& partition,
                           Config shared);

}  // namespace gs
