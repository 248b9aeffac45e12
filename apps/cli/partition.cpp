// SPDX-License-Identifier: Apache-2.0
// gemsplat partition: divides a scene into blocks that are trained apart.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>

#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "data_loaders/doctor/forecast.h"
#include "gs_app/blocks/picture_shares.h"
#include "gs_app/blocks/write_partition.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

struct PartitionCommand : CommandLine {
  std::string output;
  PartitionOptions options;
  bool force = false, dry_run = false;
};

// Gaussians at the end of a block's run: those outside of its region do not grow.
double expected_in_block(const Config& shared, const Partition& partition, const Block& block) {
  Config config = settings_of_block(shared, partition, block);
  const double outside = double(block.points_outside);
  if (config.density.max_gaussians > 0)
    config.density.max_gaussians -= std::int64_t(block.points_outside);
  return expected_gaussians(config, block.points - block.points_outside) + outside;
}

// "~130,000" for 126,512: with two digits.
std::string about(double count) {
  const double unit = std::pow(10, std::max(0.0, std::floor(std::log10(std::max(count, 1.0))) - 1));
  return "~" + with_commas(std::uint64_t(std::round(count / unit) * unit));
}

std::string text_of(const Config& config, const Partition& partition) {
  std::string text = fmt::format("{:<8} {:>7} {:>9} {:>11} {:>11} {:>11}\n", "block", "photos",
                                 "held out", "points", "outside", "Gaussians");
  for (std::size_t b = 0; b < partition.blocks.size(); ++b) {
    const Block& block = partition.blocks[b];
    text +=
        fmt::format("block{:<3} {:>7} {:>9} {:>11} {:>11} {:>11}\n", b, block.train_photos,
                    block.test_photos, with_commas(block.points), with_commas(block.points_outside),
                    about(expected_in_block(config, partition, block)));
  }
  return text;
}

// Settings with which blocks would not agree at their borders.
void warn_of(const Config& config) {
  if (config.photometric.model != "none")
    log_warning(
        "photometric.model is {}: each block learns colors of its own, and the border may show in "
        "the merged model; dataset.exposure=true solves for the photos of the whole scene",
        config.photometric.model);
  if (config.poses.refine)
    log_warning(
        "poses.refine: each block moves its photos by itself, and borders may not fit; "
        "dataset.refine_cameras=true refines the cameras of the whole scene");
}

Partition partition_of(const PartitionCommand& command, const Config& config) {
  DatasetConfig dataset = config.dataset;
  dataset.exposure = dataset.refine_cameras = false;  // of the runs; the cuts need neither
  const SceneOutline scene = outline_scene(dataset);
  if (config.model.start_from.empty()) return make_partition(scene, command.options);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  PictureShares shares(open_model(config.model.start_from, {}), config, scene, *backend);
  return make_partition(scene, command.options, std::ref(shares));
}

// Throws UsageError for a folder that holds anything, unless it may be moved aside.
void make_room(const PartitionCommand& command, const Config& config, OutputLock& lock) {
  if (is_empty_output(command.output)) return;
  if (!command.force)
    throw UsageError(command.output +
                     " is not empty; name another folder with -o, or add --force, which renames it "
                     "to " +
                     command.output + ".bak-1 or the like");
  const std::filesystem::path backup = lock.move_folder_aside(inputs_of(command, config));
  log_info("the earlier partition is now in {}", backup.string());
}

void partition(const PartitionCommand& command) {
  setup_log(command.verbosity());
  const Config config = settings_of_all_blocks(resolve(command));
  if (config.dataset.source.empty())
    throw UsageError("there is no scene; give its folder: gemsplat partition SCENE -o OUT");
  if (!config.density.region.empty())
    throw UsageError("density.region is what a partition finds for each block; leave it out");
  if (command.output.empty() && !command.dry_run)
    throw UsageError("there is no output; give a folder with -o OUT, or --dry-run");
  set_thread_count(config.train.threads);
  warn_of(config);
  if (command.dry_run) {
    std::cout << text_of(config, partition_of(command, config)) << "nothing is written\n";
    return;
  }
  check_partition(command.output, config);
  OutputLock lock = OutputLock::of_folder(command.output);
  if (!command.force) make_room(command, config, lock);  // before the work
  const Partition parts = partition_of(command, config);
  make_room(command, config, lock);
  const BlocksFile blocks = write_partition(command.output, parts, config);
  if (command.quiet) return;
  std::cout << text_of(config, parts)
            << fmt::format("train: gemsplat experiment {}\nmerge: gemsplat edit {} -o merged.ply\n",
                           (blocks.folder() / "blocks.toml").string(), blocks.folder().string());
}

}  // namespace

void add_partition(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "partition", "Divide a scene into blocks that are trained apart, for `gemsplat edit`");
  const auto command = std::make_shared<PartitionCommand>();
  CommandLine& line = *command;
  verb.add_option("-o,--output", command->output, "folder to write")->type_name("FOLDER");
  verb.add_option("--blocks", command->options.blocks, "number of blocks [2]")
      ->check(CLI::Range(2, 10'000))
      ->type_name("N");
  verb.add_option("--border", command->options.border,
                  "width of the border that a block trains beyond its planes, as a share of its "
                  "size [0.1]")
      ->check(CLI::Range(0.0, 1.0))
      ->type_name("SHARE");
  verb.add_option(
          "--least-share", command->options.least_share,
          "give a block every photo with at least this share of its sparse points (with --from: of "
          "its pixels) inside the block [0.1]")
      ->check(CLI::Range(0.0, 1.0))
      ->type_name("SHARE");
  verb.add_flag("--dry-run", command->dry_run, "print the blocks and write nothing");
  verb.add_flag("--force", command->force,
                "if the folder is not empty, rename it to FOLDER.bak-N first");
  add_dataset_options(verb, line, "scene,-s,--source-path,-d,--data");
  add_setting(verb, line, "--eval", "dataset.eval", "Scene");
  add_setting(verb, line, "--from,--start-from", "model.start_from", "Training",
              "a coarse model of the whole scene that every block starts from: a file or a run's "
              "folder; scenes with sky and far background need one");
  add_setting(verb, line, "--iterations", "train.iterations", "Training");
  add_setting(verb, line, "--max-gaussians", "density.max_gaussians", "Training",
              "most Gaussians of the merged model; each block gets its share");
  add_render_options(verb, line);
  add_general_options(verb, line);
  verb.callback([command] { partition(*command); });
}

}  // namespace gs
