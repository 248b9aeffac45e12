// SPDX-License-Identifier: Apache-2.0
// gemsplat partition: divides a scene into blocks that are trained apart.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "data_loaders/doctor/forecast.h"
#include "gs_app/blocks/picture_shares.h"
#include "gs_app/blocks/write_partition.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/output_place.h"
#include "gs_app/run/text.h"
#include "gs_core/system/files/output_lock.h"

namespace gs {
namespace {

struct PartitionJob : JobSettings {
  std::string output;
  PartitionOptions options;
  bool force = false, dry_run = false;
};

void visit_options(PartitionJob& job, OptionList& option) {
  option("-o,--output", job.output, "folder to write [beside the scene: SCENE-blocks]")
      .takes("FOLDER");
  option("--blocks", job.options.blocks, "number of blocks [2]").takes("N").between(2, 10'000);
  option("--border", job.options.border,
         "width of the border that a block trains beyond its planes, as a share of its size [0.1]")
      .takes("SHARE")
      .between(0, 1);
  option("--least-share", job.options.least_share,
         "give a block every photo with at least this share of its sparse points (with --from: of "
         "its pixels) inside the block [0.1]")
      .takes("SHARE")
      .between(0, 1);
  option("--dry-run", job.dry_run, "print the blocks and write nothing");
  option("--force", job.force, "if the folder is not empty, rename it to FOLDER.bak-N first");
  dataset_options(option, "scene,-s,--source-path,-d,--data");
  option.setting("--eval", "dataset.eval", "Scene");
  option.setting("--from,--start-from", "model.start_from", "Training",
                 "a coarse model of the whole scene that every block starts from: a file or a "
                 "run's folder; scenes with sky and far background need one");
  option.setting("--iterations", "train.iterations", "Training").rare();
  option.setting("--max-gaussians", "density.max_gaussians", "Training",
                 "most Gaussians of the merged model; each block gets its share");
  render_options(option);
  general_options(option);
}

// Gaussians at the end of a block's run: those outside of its region do not grow.
double expected_in_block(const Config& shared, const Partition& partition, const Block& block) {
  Config config = settings_of_block(shared, partition, block);
  if (config.density.max_gaussians > 0)
    config.density.max_gaussians -= std::int64_t(block.start_outside);
  const std::size_t inside = block.start - block.start_outside;
  return double(block.start_outside) + (config.model.start_from.empty()
                                            ? expected_gaussians(config, inside)
                                            : expected_gaussians_from_model(config, inside));
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

Partition partition_of(const PartitionJob& job, const Config& config) {
  DatasetConfig dataset = config.dataset;
  dataset.exposure = dataset.refine_cameras = false;  // of the runs; the cuts need neither
  const SceneOutline scene = outline_scene(dataset);
  if (config.model.start_from.empty()) return make_partition(scene, job.options);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  PictureShares shares(open_model(config.model.start_from, {}), config, scene, *backend);
  Partition partition = make_partition(scene, job.options, std::ref(shares));
  shares.start_from_model(partition.blocks);
  return partition;
}

// Throws UsageError for a folder that holds anything, unless it may be moved aside.
void make_room(const PartitionJob& job, const Config& config, OutputLock& lock) {
  if (is_empty_output(job.output)) return;
  if (!job.force)
    throw UsageError(job.output +
                     " is not empty; name another folder with -o, or add --force, which renames it "
                     "to " +
                     job.output + ".bak-1 or the like");
  const std::filesystem::path backup = lock.move_folder_aside(inputs_of(job, config));
  log_info("the earlier partition is now in {}", backup.string());
}

Json json_of(const Config& config, const Partition& partition) {
  Json blocks = Json::array();
  for (std::size_t b = 0; b < partition.blocks.size(); ++b) {
    const Block& block = partition.blocks[b];
    blocks.push_back({{"name", fmt::format("block{}", b)},
                      {"train_photos", block.train_photos},
                      {"test_photos", block.test_photos},
                      {"points", block.points},
                      {"points_outside", block.points_outside},
                      {"expected_gaussians", expected_in_block(config, partition, block)}});
  }
  return {{"blocks", blocks}};
}

Outcome run(PartitionJob job, JobEvents&) {
  const Config config = settings_of_all_blocks(resolve_to_work(job));
  if (config.dataset.source.empty())
    throw UsageError("there is no scene; give its folder: gemsplat partition SCENE");
  if (!config.density.region.empty())
    throw UsageError("density.region is what a partition finds for each block; leave it out");
  warn_of(config);
  if (job.dry_run) {
    const Partition parts = partition_of(job, config);
    return {text_of(config, parts) +
                "nothing is written; the same command without --dry-run writes the blocks\n",
            json_of(config, parts),
            {},
            true};
  }
  if (job.output.empty()) job.output = new_place(beside(config.dataset.source, "-blocks")).string();
  check_partition(job.output, config);
  OutputLock lock = OutputLock::of_folder(job.output);
  if (!job.force) make_room(job, config, lock);  // before the work
  const Partition parts = partition_of(job, config);
  make_room(job, config, lock);
  const BlocksFile blocks = write_partition(job.output, parts, config);
  const std::string experiment = (blocks.folder() / "blocks.toml").string();
  Outcome outcome{text_of(config, parts), json_of(config, parts)};
  outcome.json["file"] = blocks.file.string();
  outcome.next = {{"train", "gemsplat experiment " + shell_word(experiment)},
                  {"merge", "gemsplat edit " + shell_word(blocks.folder().string())}};
  return outcome;
}

}  // namespace

Verb partition_verb() {
  return verb_of<PartitionJob>(
      "partition", VerbGroup::train,
      "Divide a scene into blocks that are trained apart, for `gemsplat edit`",
      {"partition scene --blocks 4 --dry-run", "partition scene -o city --blocks 4 --eval",
       "partition scene -o city --blocks 12 --from out/coarse"});
}

}  // namespace gs
