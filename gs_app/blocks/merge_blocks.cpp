// SPDX-License-Identifier: Apache-2.0
#include "gs_app/blocks/merge_blocks.h"

#include <spdlog/fmt/fmt.h>

#include <map>

#include "gs_app/edit/edit_cameras.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_model/edit/merge_models.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

Config settings_of_run(const RunFolder& run) {
  std::error_code ignored;
  if (!fs::exists(run.config(), ignored))
    throw Error("there is no run in " + run.root().string() +
                "; name the folder that `gemsplat train -o` has written");
  Config config;
  load_config(config, run.config());
  return config;
}

// The runs that were named, by the blocks that they are of.
std::map<std::size_t, fs::path> named_runs(const BlocksFile& blocks,
                                           const std::vector<fs::path>& elsewhere) {
  std::map<std::size_t, fs::path> runs;
  for (const fs::path& folder : elsewhere) {
    const std::string region = settings_of_run(RunFolder(folder)).density.region;
    std::size_t b = 0;
    while (b < blocks.blocks.size() && blocks.blocks[b].region != region) ++b;
    if (b == blocks.blocks.size())
      throw UsageError(
          fmt::format("the run in {} is of no block of {}: its density.region is "
                      "another one; train the block with its config, or name the "
                      "partition that the run belongs to",
                      folder.string(), blocks.file.string()));
    if (const auto [first, is_new] = runs.emplace(b, folder); !is_new)
      throw UsageError(fmt::format("{} and {} are both runs of {}; name one of them",
                                   first->second.string(), folder.string(), blocks.blocks[b].name));
  }
  return runs;
}

// Throws unless the folder has a model of this block to merge.
void check_run(const BlocksFile& blocks, const BlockEntry& block, const RunFolder& run,
               const std::optional<int>& step) {
  const std::string remedy =
      fmt::format("train the blocks with `gemsplat experiment {}`, or name the run with --run",
                  (blocks.folder() / "blocks.toml").string());
  std::error_code ignored;
  if (!fs::exists(run.config(), ignored))
    throw Error(fmt::format("{} has no run in {}; {}", block.name, run.root().string(), remedy));
  if (settings_of_run(run).density.region != block.region)
    throw UsageError(fmt::format(
        "the run in {} was trained for another partition than {}: its density.region differs; {}",
        run.root().string(), blocks.file.string(), remedy));
  if (!step && !fs::exists(run.results(), ignored))
    throw Error(
        fmt::format("{} is not finished: {} has no results.json yet; go on with `gemsplat "
                    "experiment {}`, or merge models of one step with --iteration",
                    block.name, run.root().string(), (blocks.folder() / "blocks.toml").string()));
}

void warn_of_own_looks(const BlockEntry& block, const RunFolder& run) {
  std::error_code ignored;
  if (fs::exists(run.photometric(), ignored))
    log_warning(
        "{} has learned a photometric model of its own, so its colors may differ from those of "
        "other blocks; train blocks with dataset.exposure instead of photometric.model, which "
        "solves for the whole scene",
        block.name);
  if (fs::exists(run.poses(), ignored))
    log_warning(
        "{} has refined poses of its own, so its border may not fit; refine the poses of the whole "
        "scene before, with dataset.refine_cameras",
        block.name);
}

}  // namespace

std::vector<std::uint32_t> rows_in_part(const GaussianModel& model, const CutTree& tree,
                                        std::size_t part) {
  std::vector<std::uint32_t> rows;
  for (std::uint32_t i = 0; i < model.gaussians.count(); ++i)
    if (tree.part_of(Vec3d(model.gaussians.mean[i]) + model.world_offset) == part)
      rows.push_back(i);
  return rows;
}

MergedBlocks merge_blocks(const BlocksFile& blocks, const BlockRuns& runs) {
  const std::map<std::size_t, fs::path> named = named_runs(blocks, runs.elsewhere);
  MergedBlocks result;
  for (std::size_t b = 0; b < blocks.blocks.size(); ++b) {
    const auto found = named.find(b);
    const fs::path run =
        found == named.end() ? blocks.folder() / blocks.blocks[b].run : found->second;
    check_run(blocks, blocks.blocks[b], RunFolder(run), runs.step);
    result.shares.push_back({blocks.blocks[b].name, run});
  }
  std::vector<NamedModel> models;
  for (std::size_t b = 0; b < blocks.blocks.size(); ++b) {
    BlockShare& share = result.shares[b];
    warn_of_own_looks(blocks.blocks[b], RunFolder(share.run));
    EditModel model = model_to_edit(open_model(share.run, runs.step));
    share.gaussians = model.model.gaussians.count();
    keep_rows(model, rows_in_part(model.model, blocks.tree, b));
    share.owned = model.model.gaussians.count();
    models.push_back({share.run.string(), std::move(model)});
  }
  result.model = merge_models(std::move(models));
  return result;
}

}  // namespace gs
