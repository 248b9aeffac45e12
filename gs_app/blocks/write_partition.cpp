// SPDX-License-Identifier: Apache-2.0
#include "gs_app/blocks/write_partition.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "data_loaders/scene/photo_list.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/config/text/config_text.h"
#include "gs_core/config/text/region_text.h"
#include "gs_core/density/growth_method.h"
#include "gs_core/error.h"
#include "gs_core/system/text/foreign_text.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

std::string absolute_path(const std::string& path) {
  return path.empty() ? path : fs::absolute(path).lexically_normal().string();
}

void make_paths_absolute(Config& config) {
  for (std::string* path :
       {&config.dataset.source, &config.dataset.photo_list, &config.model.start_from})
    *path = absolute_path(*path);
  if (config.eval.lpips != "none") config.eval.lpips = absolute_path(config.eval.lpips);
}

// What a block changes of the settings that all share. The list is named by its whole path, so that
// `gemsplat train -c` finds it from anywhere.
std::string block_toml(const Config& block, const Config& shared) {
  std::string text = fmt::format(
      "# A block of a divided scene: gemsplat train -c THIS_FILE -o OUT trains it alone.\n"
      "base = \"shared.toml\"\n\n[dataset]\nphoto_list = {}\n\n[density]\nregion = {}\n",
      toml_text(block.dataset.photo_list), toml_text(block.density.region));
  if (block.density.max_gaussians != shared.density.max_gaussians)
    text += fmt::format("max_gaussians = {}\n", block.density.max_gaussians);
  return text;
}

std::string experiment_toml(const BlocksFile& blocks, std::uint64_t seed) {
  std::string configs;
  for (const BlockEntry& block : blocks.blocks)
    configs += fmt::format("{}\"{}\"", configs.empty() ? "" : ", ", block.config);
  return fmt::format(
      "# Trains all blocks of a divided scene: gemsplat experiment blocks.toml; then gemsplat "
      "edit\n"
      "# makes one model of them. For a cluster add [slurm] (docs/guide/experiments.md) and give "
      "--slurm.\n"
      "output = \"runs\"\n"
      "scenes = [{{path = {}, name = \"scene\"}}]\n"
      "configs = [{}]\n"
      "seeds = [{}]\n",
      toml_text(blocks.scene), configs, seed);
}

}  // namespace

Config settings_of_all_blocks(Config config) {
  if (config.model.start_from.empty()) return config;
  DensityConfig& density = config.density;
  density.reset_opacity_until = 0;
  const GrowthMethod& method = growth_method(density.strategy);
  if (method.prune_unseen || method.prunes_shares())
    throw UsageError(
        "density.strategy = \"" + density.strategy +
        "\" removes what the photos of a block do not show, and blocks that start from "
        "a model keep it; take another one, such as --strategy growth");
  density.opacity_regularizer = 0;  // it fades what no photo of the block sees
  return config;
}

Config settings_of_block(Config shared, const Partition& partition, const Block& block) {
  std::int64_t& limit = shared.density.max_gaussians;
  if (limit > 0) {
    const double inside = double(block.points - block.points_outside);
    limit = std::llround(double(limit) * inside / double(partition.points)) +
            std::int64_t(block.start_outside);
  }
  shared.density.region = text_of_region(block.region);
  return shared;
}

void check_partition(const fs::path& folder, Config shared) {
  make_paths_absolute(shared);
  to_toml(shared);  // throws where a path cannot be written down
  if (const std::string whole = fs::absolute(folder).string(); !is_utf8(whole))
    throw UsageError(whole +
                     " is not UTF-8, so that no file of a partition can name it; choose another "
                     "folder with -o");
}

BlocksFile write_partition(const fs::path& folder, const Partition& partition, Config shared) {
  check_partition(folder, shared);
  make_paths_absolute(shared);
  shared.model.output.clear();
  BlocksFile blocks;
  blocks.file = fs::absolute(folder).lexically_normal() / "blocks.json";
  blocks.scene = shared.dataset.source;
  blocks.up = partition.up;
  blocks.tree = partition.tree;
  write_text(blocks.folder() / "shared.toml", to_toml(shared));
  for (std::size_t b = 0; b < partition.blocks.size(); ++b) {
    const Block& block = partition.blocks[b];
    Config settings = settings_of_block(shared, partition, block);
    BlockEntry entry;
    entry.name = fmt::format("block{}", b);
    entry.config = entry.name + ".toml";
    entry.run = fmt::format("runs/scene/{}/seed{}", entry.name, shared.train.seed);
    entry.region = settings.density.region;
    entry.train_photos = block.train_photos;
    entry.test_photos = block.test_photos;
    entry.points = block.points;
    entry.points_outside = block.points_outside;
    const fs::path list = blocks.folder() / (entry.name + ".txt");
    settings.dataset.photo_list = list.string();
    write_photo_list(list, block.photos);
    write_text(blocks.folder() / entry.config, block_toml(settings, shared));
    blocks.blocks.push_back(std::move(entry));
  }
  write_text(blocks.folder() / "blocks.toml", experiment_toml(blocks, shared.train.seed));
  write_text(blocks.file, blocks_json(blocks));  // last: it says that the partition is whole
  return blocks;
}

}  // namespace gs
