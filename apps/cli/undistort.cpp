// SPDX-License-Identifier: Apache-2.0
// gemsplat undistort: a copy of a scene with PINHOLE cameras, for builds without OpenCV.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "data_loaders/scene/find_scene.h"
#include "data_loaders/scene/undistort_scene.h"
#include "gs_app/run/progress_bar.h"
#include "gs_core/error.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

struct UndistortCommand : CommandLine {
  std::string output;
  int jpeg_quality = 0;
  bool force = false;
};

std::string text_of(const UndistortedScene& scene, const UndistortCommand& command) {
  std::string text =
      fmt::format("{}: {} photos undistorted, {} copied, {} masks{}\n", command.output,
                  scene.undistorted, scene.copied, scene.masks,
                  scene.depth_maps > 0 ? fmt::format(", {} depth maps", scene.depth_maps) : "");
  if (scene.undistorted > 0 && command.jpeg_quality > 0)
    text += fmt::format(
        "JPEG of quality {} loses some detail: {:.1f} dB compared with the undistorted pixels; "
        "without --jpeg, PNG loses nothing\n",
        command.jpeg_quality, scene.jpeg_psnr);
  text += fmt::format("train on it with: gemsplat train {}{} -o RUN\n", command.output,
                      scene.needs_background ? " --mask-mode background" : "");
  return text;
}

void undistort(const UndistortCommand& command) {
  setup_log(command.verbosity());
  const Config config = resolve(command);
  if (config.dataset.source.empty())
    throw UsageError("there is no scene; give its folder: gemsplat undistort SCENE -o OUT");
  set_thread_count(config.train.threads);
  if (command.force) {
    find_scene(config.dataset);  // a wrong name moves nothing
    OutputLock::of_freed_folder(command.output, inputs_of(command, config));
  }
  std::unique_ptr<ProgressBar> bar;
  const UndistortedScene scene =
      undistort_scene(config.dataset, command.output, command.jpeg_quality,
                      [&](std::size_t done, std::size_t total) {
                        if (!bar)
                          bar = std::make_unique<ProgressBar>(std::int64_t(total), !command.quiet);
                        if (bar->due(std::int64_t(done)))
                          bar->draw(std::int64_t(done), "", "photo");
                      });
  if (bar) bar->clear();
  if (!command.quiet) std::cout << text_of(scene, command);
}

}  // namespace

void add_undistort(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "undistort", "Write a copy of a scene with undistorted photos and PINHOLE cameras");
  const auto command = std::make_shared<UndistortCommand>();
  CommandLine& line = *command;
  add_setting(verb, line, "scene,-s,--source-path,-d,--data", "dataset.source", "Scene");
  add_setting(verb, line, "--images", "dataset.images", "Scene");
  add_setting(verb, line, "--masks", "dataset.masks", "Scene");
  add_setting(verb, line, "--invert-masks", "dataset.invert_masks", "Scene");
  add_setting(verb, line, "--depth", "dataset.depth", "Scene");
  verb.add_option("-o,--output", command->output,
                  "folder of the copy; it must be empty or not exist")
      ->type_name("FOLDER")
      ->required();
  verb.add_flag("--force", command->force,
                "if the folder is not empty, rename it to FOLDER.bak-N first");
  verb.add_option("--jpeg", command->jpeg_quality,
                  "write JPEG of this quality, 1 to 100, instead of PNG, and print the loss")
      ->check(CLI::Range(1, 100))
      ->type_name("QUALITY");
  add_general_options(verb, line);
  verb.callback([command] { undistort(*command); });
}

}  // namespace gs
