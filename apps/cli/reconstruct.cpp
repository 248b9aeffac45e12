// SPDX-License-Identifier: Apache-2.0
// gemsplat reconstruct: makes a scene from photos or videos with the program colmap.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "apps/cli/options.h"
#include "apps/cli/reconstruct.h"
#include "apps/cli/verbs.h"
#include "data_loaders/reconstruct/photo_folder.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/scene_model.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"

namespace gs {
namespace {

struct ReconstructCommand : CommandLine {
  std::string scene;
  bool force = false;
};

/// The cameras and poses of a scene that has no points; null for photos alone, and for a scene with
/// points, whose poses are found anew. `photos` becomes the folder of its photos.
std::shared_ptr<const ColmapModel> poses_without_points(const DatasetConfig& dataset,
                                                        std::filesystem::path& photos) {
  std::error_code ignored;
  if (!std::filesystem::is_directory(dataset.source, ignored) || holds_only_photos(dataset.source))
    return nullptr;
  SceneFolders folders;
  try {
    folders = find_scene(dataset);
  } catch (const Error&) {  // no scene: photos, or a sentence that helps
    return nullptr;
  }
  ColmapModel model = read_scene(dataset, folders).model;
  if (!model.points.empty()) return nullptr;
  log_info("{} has cameras and no points: COLMAP finds points for these cameras", dataset.source);
  photos = folders.images;
  return std::make_shared<const ColmapModel>(std::move(model));
}

void reconstruct(const ReconstructCommand& command) {
  const Config config = resolve(command);
  if (config.dataset.source.empty())
    throw UsageError(
        "there are no photos; give their folder, or a video: gemsplat reconstruct PHOTOS -o SCENE");
  if (command.scene.empty())
    throw UsageError("there is no output; give the folder of the scene with -o SCENE");
  setup_log(command.verbosity());
  ColmapJob job{config.dataset.source, command.scene, config.reconstruct,
                config.train.threads,  command.force, true};
  job.poses = poses_without_points(config.dataset, job.photos);
  const Reconstruction result = run_colmap(job, ColmapBar(!command.quiet));
  if (!command.quiet)
    std::cout << describe(result)
              << fmt::format("scene: {} (log: {})\ntrain it with: gemsplat train {} -o OUT\n",
                             command.scene, (result.scene / "colmap.log").string(), command.scene);
}

}  // namespace

void ColmapBar::operator()(ColmapStage stage, std::int64_t done, std::int64_t total) {
  if (done == 0 || stage != stage_ || total != total_)
    bar_ = std::make_shared<ProgressBar>(total, enabled_);
  stage_ = stage;
  total_ = total;
  if (done > 0 && bar_->due(done)) bar_->draw(done, "", unit());
}

const char* ColmapBar::unit() const {
  return stage_ == ColmapStage::frames    ? "frame"
         : stage_ == ColmapStage::matches ? "block"
                                          : "photo";
}

void add_reconstruct(CLI::App& program) {
  CLI::App& verb =
      *program.add_subcommand("reconstruct", "Find where photos were taken, with COLMAP");
  const auto command = std::make_shared<ReconstructCommand>();
  CommandLine& line = *command;
  add_setting(verb, line, "photos,-d,--data", "dataset.source", "Scene",
              "a folder of photos or videos, or a video; nothing in it is changed");
  verb.add_option("-o,--output", command->scene, "folder of the new scene")
      ->type_name("FOLDER")
      ->group("Output");
  verb.add_flag("--force", command->force, "if SCENE holds a scene, move it to SCENE.bak-N first")
      ->group("Output");
  add_setting(verb, line, "--frames", "reconstruct.frames", "COLMAP");
  add_setting(verb, line, "--matching", "reconstruct.matching", "COLMAP");
  add_setting(verb, line, "--camera-model", "reconstruct.camera_model", "COLMAP");
  add_setting(verb, line, "--single-camera", "reconstruct.single_camera", "COLMAP");
  add_setting(verb, line, "--max-features", "reconstruct.max_features", "COLMAP");
  add_setting(verb, line, "--colmap", "reconstruct.colmap", "COLMAP");
  add_general_options(verb, line);
  verb.callback([command] { reconstruct(*command); });
}

}  // namespace gs
