// SPDX-License-Identifier: Apache-2.0
// gemsplat convert-cameras: a COLMAP model with PINHOLE or OPENCV cameras, for other programs.
#include "data_loaders/refine/convert_cameras.h"

#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "data_loaders/counted.h"
#include "data_loaders/scene/find_scene.h"
#include "gs_core/error.h"
#include "gs_core/system/files/output_lock.h"

namespace gs {
namespace {

struct ConvertCommand : CommandLine {
  std::string output, camera_model = "OPENCV";
  double max_error = 1;
  bool force = false;
};

void convert(const ConvertCommand& command) {
  setup_log(command.verbosity());
  const Config config = resolve(command);
  if (config.dataset.source.empty())
    throw UsageError("there is no scene; give its folder: gemsplat convert-cameras SCENE -o OUT");
  const CameraModel target =
      command.camera_model == "PINHOLE" ? CameraModel::pinhole : CameraModel::opencv;
  const auto model = find_scene(config.dataset).model;
  if (command.force) {
    std::vector<std::filesystem::path> needed = inputs_of(command, config);
    needed.push_back(model);
    OutputLock::of_freed_folder(command.output, needed);
  }
  const std::vector<FittedCamera> fits =
      convert_cameras(model, command.output, target, command.max_error);
  if (command.quiet) return;
  for (const FittedCamera& fit : fits)
    std::cout << fmt::format("camera {}: error {:.4f} pixels in the mean, {:.4f} at most\n",
                             fit.camera.id, fit.mean_error, fit.max_error);
  std::cout << fmt::format("{} of {} as {} in {}\n", counted(fits.size(), "camera"), model.string(),
                           command.camera_model, command.output);
}

}  // namespace

void add_convert_cameras(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "convert-cameras",
      "Write a scene's COLMAP model with PINHOLE or OPENCV cameras instead of its own");
  const auto command = std::make_shared<ConvertCommand>();
  CommandLine& line = *command;
  add_setting(verb, line, "scene,-s,--source-path,-d,--data", "dataset.source", "Scene");
  add_setting(verb, line, "--images", "dataset.images", "Scene");
  verb.add_option("-o,--output", command->output,
                  "folder of the new model; it must be empty or not exist")
      ->type_name("FOLDER")
      ->required();
  verb.add_flag("--force", command->force,
                "if the folder is not empty, rename it to FOLDER.bak-N first");
  verb.add_option("--camera-model", command->camera_model, "camera model of the new files [OPENCV]")
      ->check(CLI::IsMember({"PINHOLE", "OPENCV"}))
      ->type_name("PINHOLE|OPENCV");
  verb.add_option("--max-error", command->max_error, "refuse a conversion with a larger error [1]")
      ->check(CLI::PositiveNumber)
      ->type_name("PIXELS");
  add_general_options(verb, line);
  verb.callback([command] { convert(*command); });
}

}  // namespace gs
