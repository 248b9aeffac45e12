// SPDX-License-Identifier: Apache-2.0
// The models of all blocks become one: each Gaussian is that of the block which owns the place of
// its mean.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "gs_app/blocks/blocks_file.h"
#include "gs_model/edit/edit_model.h"

namespace gs {

struct BlockRuns {
  // Runs that were trained elsewhere than the partition's experiment would; the block of each is
  // known by its density.region.
  std::vector<std::filesystem::path> elsewhere;
  std::optional<int> step;  // which model of each run; none: the last one of a finished run
};

/// What the merge took of a block.
struct BlockShare {
  std::string name;
  std::filesystem::path run;
  std::size_t gaussians = 0, owned = 0;
};

struct MergedBlocks {
  EditModel model;
  std::vector<BlockShare> shares;  // (blocks)
};

/// The rows of a model whose means lie in a part, ascending. A mean that is not a number lies in
/// some part.
std::vector<std::uint32_t> rows_in_part(const GaussianModel& model, const CutTree& tree,
                                        std::size_t part);

/// Merges the models of all blocks, in the order of the blocks. Warns where blocks have learned
/// colors or poses of their own. Throws Error that names the block and the command that goes on
/// where one has no finished run, and UsageError for a run of another partition.
MergedBlocks merge_blocks(const BlocksFile& blocks, const BlockRuns& runs);

}  // namespace gs
