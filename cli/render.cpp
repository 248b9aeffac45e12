// SPDX-License-Identifier: Apache-2.0
// gemsplat render: pictures of a trained model, of any trainer, from given cameras.
#include <CLI/CLI.hpp>
#include <iostream>
#include <memory>

#include "cli/cameras.h"
#include "cli/devices.h"
#include "cli/options.h"
#include "cli/pictures.h"
#include "cli/progress_bar.h"
#include "cli/verbs.h"
#include "data_loaders/photos.h"
#include "gs_api/open_model.h"
#include "gs_core/error.h"
#include "gs_core/parallel.h"

namespace gs {
namespace {

struct RenderCommand : CommandLine {
  std::string model, output, cameras, split = "all";
  std::optional<int> step;
};

// From --cameras, --data, or the run itself.
std::vector<NamedCamera> cameras_of(const RenderCommand& command, const OpenedModel& opened,
                                    const Config& config) {
  const int resolution = config.dataset.resolution;
  if (command.has("dataset.source"))
    return cameras_of_scene(config.dataset, command.split, opened.model.world_offset);
  if (command.cameras.empty() && opened.run)
    return cameras_of_run(*opened.run, resolution, command.split, opened.model.world_offset);
  if (command.cameras.empty())
    throw UsageError("from where? give --cameras FILE (a cameras.json) or --data SCENE");
  if (command.split != "all")
    throw UsageError("--split goes with --data or a run, not with --cameras");
  return cameras_of_file(command.cameras, resolution, opened.model.world_offset);
}

void render(const RenderCommand& command) {
  setup_log(command.verbosity());
  OpenedModel opened = open_model(command.model, command.step);
  // A cameras.json has the size of its pictures already; only -r makes them smaller.
  if (!command.has("dataset.source")) opened.config.dataset.resolution = 1;
  const Config config = resolve(command, opened.config);
  set_thread_count(config.train.threads);
  const std::vector<NamedCamera> cameras = cameras_of(command, opened, config);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const Gaussians gaussians = copy_to(backend->memory(), opened.model);
  const RenderSettings settings = view_settings(opened, config);
  RenderPass pass(backend->memory());
  ProgressBar bar(std::int64_t(cameras.size()), !command.quiet);
  std::int64_t done = 0;
  for (const auto& [name, camera] : cameras) {
    backend->renderer().forward(gaussians.span(), camera, settings, pass);
    write_png(picture_path(command.output, name), to_image8(image_of(pass)));
    if (bar.due(++done)) bar.draw(done, name, "view");
  }
  bar.clear();
  if (!command.quiet)
    std::cout << cameras.size() << " pictures of " << opened.ply.string() << " in "
              << command.output << "\n";
}

}  // namespace

void add_render(CLI::App& program) {
  CLI::App& verb =
      *program.add_subcommand("render", "Render a trained model from given cameras to PNG");
  const auto command = std::make_shared<RenderCommand>();
  verb.add_option("model", command->model,
                  "a PLY, .spz, .sog, .splat or .csv of any trainer, or a run's folder")
      ->type_name("MODEL|RUN")
      ->required();
  verb.add_option("-o,--output", command->output, "folder of the pictures, named after their views")
      ->type_name("FOLDER")
      ->required();
  verb.add_option("--iteration", command->step,
                  "of a run, the model saved after that step [the newest]")
      ->type_name("STEP");
  verb.add_option("--cameras", command->cameras, "cameras.json [that of the run]")
      ->type_name("FILE")
      ->group("Scene");
  add_dataset_options(verb, *command, "-d,--data,-s,--source-path");
  verb.get_option("--data")->excludes("--cameras");
  verb.add_option("--split", command->split, "which views of the run or of --data [all]")
      ->check(CLI::IsMember({"test", "train", "all"}))
      ->type_name("")
      ->group("Scene");
  add_render_options(verb, *command);
  add_general_options(verb, *command);
  verb.callback([command] { render(*command); });
}

}  // namespace gs
