// SPDX-License-Identifier: Apache-2.0
// gemsplat export: a trained model in the formats of viewers, and what each format costs.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <iostream>
#include <memory>
#include <utility>

#include "apps/cli/devices.h"
#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "data_loaders/georef/georef_file.h"
#include "gs_app/export/cameras.h"
#include "gs_app/export/export_model.h"
#include "gs_app/run/open_model.h"
#include "gs_app/view/page/model_page.h"
#include "gs_core/error.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/files/output_names.h"
#include "gs_core/threads/parallel.h"
#include "gs_model/tiles/tileset.h"

namespace gs {
namespace {

struct ExportCommand : CommandLine {
  std::string model;
  std::vector<std::string> outputs;
  std::optional<int> step;
  std::optional<double> time;
  ExportOptions options;
  std::vector<double> up;  // empty: no turn
  double scale = 1;
  std::string georef;  // empty: that of the scene, if there is one
  std::string title;   // of a page; empty: the name of the scene
  std::size_t tile_gaussians = kTileGaussiansAtMost;
  bool recenter = false, force = false, table = false, unmeasured = false;
};

ModelTransform transform_of(const ExportCommand& command, const GaussianModel& model) {
  ModelTransform transform;
  if (command.recenter) transform.center = median_mean(model);
  if (!command.up.empty()) {
    const Vec3d up{command.up[0], command.up[1], command.up[2]};
    if (!is_finite(up) || up == Vec3d(0.0)) throw UsageError("--up has no direction");
    transform.turn = turn_upright(up);
  }
  if (!std::isfinite(command.scale)) throw UsageError("--scale is no number");
  transform.scale = command.scale;
  return transform;
}

/// Where the model's scene stands on earth, if that is known.
std::optional<Georeference> georeference_of(const ExportCommand& command, const Config& config) {
  if (!command.georef.empty()) return read_georef(command.georef);
  const std::string& scene = config.dataset.source;
  if (scene.empty() || !std::filesystem::exists(georef_file_of(scene))) return {};
  return read_georef(georef_file_of(scene));
}

/// What must stay where it is while the folders of outputs are made.
std::vector<std::filesystem::path> inputs_of(const ExportCommand& command, const Config& config) {
  std::vector<std::filesystem::path> inputs =
      inputs_of(static_cast<const CommandLine&>(command), config);
  inputs.insert(inputs.end(), {command.model, command.georef});
  return inputs;
}

/// An output that ends in / is the folder of a tileset.
bool is_tileset(const ExportCommand& command, const std::string& output) {
  return !command.table && output.ends_with('/');
}

/// An output that ends in .html is the viewer's page with the model inside.
bool is_page(const ExportCommand& command, const std::string& output) {
  return !command.table && is_model_page(output);
}

std::vector<std::filesystem::path> pages_of(const ExportCommand& command, OutputNames& names) {
  std::vector<std::filesystem::path> pages;
  for (const std::string& output : command.outputs) {
    if (!is_page(command, output)) continue;
    if (command.recenter || !command.up.empty() || command.scale != 1)
      throw UsageError(
          "--recenter, --up and --scale move the model, and a page has the cameras of the run "
          "beside it; leave them out, or export a moved model first, and then its page");
    check_model_page(output, command.force);
    names.add_file(output);
    pages.emplace_back(output);
  }
  if (!command.title.empty() && pages.empty())
    throw UsageError("--title is what a page is called, and no output ends in .html");
  return pages;
}

std::vector<TilesetRequest> tilesets_of(const ExportCommand& command, const Config& config,
                                        const std::optional<Georeference>& georeference,
                                        OutputNames& names) {
  std::vector<TilesetRequest> tilesets;
  for (const std::string& output : command.outputs) {
    if (!is_tileset(command, output)) continue;
    if (!georeference)
      throw UsageError(output +
                       " is to be a tileset, which stands on earth, and nothing says where: run "
                       "`gemsplat georef SCENE` first, or name its file with --georef FILE");
    if (command.recenter || !command.up.empty() || command.scale != 1)
      throw UsageError(
          "--recenter, --up and --scale move the model, and a tileset stands where the scene is; "
          "leave them out");
    tilesets.push_back({std::filesystem::path(output).parent_path(), *georeference,
                        config.model.sh_degree, command.tile_gaussians,
                        inputs_of(command, config)});
    check_tileset(tilesets.back(), command.force);
    names.add_folder(tilesets.back().folder);
  }
  return tilesets;
}

std::filesystem::path table_file(const std::string& folder) {
  return std::filesystem::path(folder) / "formats.md";
}

// The files of --table: one in each format that this build writes and that holds the model.
std::vector<std::string> files_of_table(const std::string& folder, const ExportOptions& options,
                                        const GaussianModel& model) {
  std::vector<std::string> files;
  for (const ModelFormat& format : model_formats()) {
    if (!holds(format, model.gaussians.has_time)) continue;
    try {
      format.require(options);
      files.push_back(folder + "/model" + std::string(format.ending));
    } catch (const Error& missing) {
      log_warning("{} is left out: {}", format.name, missing.what());
    }
  }
  return files;
}

std::vector<ExportRequest> requests_of(const ExportCommand& command, const OpenedModel& opened,
                                       int sh_degree,
                                       const std::optional<Georeference>& georeference,
                                       OutputNames& names) {
  const GaussianModel& model = opened.model;
  const ModelTransform transform = transform_of(command, model);
  std::vector<ExportRequest> requests;
  if (command.table && command.outputs.size() != 1)
    throw UsageError("--table takes one folder, in which it writes a file of each format");
  for (const std::string& file :
       command.table ? files_of_table(command.outputs[0], command.options, model) : command.outputs)
    if (!is_tileset(command, file) && !is_page(command, file))
      requests.push_back(
          {file, command.options, transform, sh_degree, opened.input_from_model, georeference});
  for (const ExportRequest& request : requests) {
    check_export(request, command.force);
    check_holds(format_to_write(request.file), model.gaussians.has_time, request.file.string());
    names.add_file(request.file);
    names.add_file(sidecar_of(request.file));
  }
  if (command.table) check_place(table_file(command.outputs[0]), command.force);
  return requests;
}

bool is_any_lossy(const std::vector<ExportRequest>& requests, int sh_degree) {
  return std::any_of(requests.begin(), requests.end(),
                     [&](const ExportRequest& request) { return is_lossy(request, sh_degree); });
}

// The test views of --data or of the run, or all views where there are no test views.
std::vector<NamedCamera> cameras_of(const ExportCommand& command, const OpenedModel& opened,
                                    const Config& config, const char*& what) {
  std::vector<NamedCamera> cameras;
  const Vec3d& offset = opened.model.world_offset;
  const bool has_scene = command.has("dataset.source");
  const bool has_cameras = opened.run && std::filesystem::exists(opened.run->cameras());
  const bool has_split = opened.run && std::filesystem::exists(opened.run->split());
  for (const auto& [split, words] : {std::pair{"test", "{} test views"}, {"all", "all {} views"}}) {
    what = words;
    if (has_scene)
      cameras = cameras_of_scene(config.dataset, split, offset);
    else if (has_cameras && (has_split || split != std::string_view("test")))
      cameras = cameras_of_run(*opened.run, 1, split, offset);
    if (!cameras.empty()) return cameras;
  }
  log_info(
      "the loss of lossy formats is not measured: there are no views; give --data SCENE, or export "
      "a run");
  return cameras;
}

void export_all(const ExportCommand& command, const std::vector<ExportRequest>& requests,
                const GaussianModel& model, const Viewpoints* viewpoints) {
  std::vector<ExportedFile> files;
  for (const ExportRequest& request : requests) {
    try {
      files.push_back(export_model(model, request, viewpoints));
    } catch (const Error& error) {
      if (!command.table || error.code() != ExitCode::bad_data) throw;
      log_warning("{} is left out: {}", request.file.string(), error.what());
      continue;
    }
    if (!command.quiet) std::cout << summary(files.back(), viewpoints) << std::endl;
  }
  if (!command.table) return;
  const std::string table = export_table(files);
  const OutputLock lock = OutputLock::of_file(table_file(command.outputs[0]));
  keep_older_aside(table_file(command.outputs[0]));
  write_text(table_file(command.outputs[0]), table);
  std::cout << "\n" << table;
}

void export_tilesets(const ExportCommand& command, const std::vector<TilesetRequest>& tilesets,
                     const GaussianModel& model) {
  for (const TilesetRequest& request : tilesets) {
    const ExportedTileset tileset = export_tileset(model, request);
    if (!command.quiet) std::cout << summary(tileset, request.georeference) << std::endl;
  }
}

void export_pages(const ExportCommand& command, const std::vector<std::filesystem::path>& pages,
                  const OpenedModel& opened, const Config& config) {
  for (const std::filesystem::path& file : pages) {
    const ModelPage page =
        write_model_page(file, opened, config, config.model.sh_degree, command.title);
    if (!command.quiet) std::cout << summary(page) << std::endl;
  }
}

void run_export(const ExportCommand& command) {
  setup_log(command.verbosity());
  OpenedModel opened = open_model(command.model, command.step);
  if (command.time) take_moment(opened, *command.time);
  const Config config = resolve(command, opened.config);
  set_thread_count(config.train.threads);
  const int sh_degree = config.model.sh_degree;
  const std::optional<Georeference> georeference = georeference_of(command, config);
  OutputNames names;
  const std::vector<ExportRequest> requests =
      requests_of(command, opened, sh_degree, georeference, names);
  const std::vector<TilesetRequest> tilesets = tilesets_of(command, config, georeference, names);
  const std::vector<std::filesystem::path> pages = pages_of(command, names);
  export_tilesets(command, tilesets, opened.model);
  export_pages(command, pages, opened, config);
  if (command.unmeasured || !is_any_lossy(requests, opened.model.sh_degree))
    return export_all(command, requests, opened.model, nullptr);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const Gaussians gaussians = copy_to(backend->memory(), opened.model);
  Viewpoints viewpoints{*backend, gaussians.span(), settings_of_model(opened, config), {}};
  for (const NamedCamera& named : cameras_of(command, opened, config, viewpoints.what))
    viewpoints.cameras.push_back(named.camera);
  export_all(command, requests, opened.model, &viewpoints);
}

}  // namespace

void add_export(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand("export", "Write a trained model in other formats");
  const auto command = std::make_shared<ExportCommand>();
  verb.add_option("model", command->model,
                  "a model in any format that gemsplat reads, or a run's folder")
      ->type_name("MODEL|RUN")
      ->required();
  verb.add_option(
          "output", command->outputs,
          "files to write, each with a FILE.transforms.json that describes it; the ending of a "
          "name chooses its format: " +
              format_names() +
              "; .html is a page that shows the model without a server; a name that ends in / is "
              "the "
              "folder of a 3D Tiles tileset, which needs a georeference")
      ->type_name("FILE")
      ->required();
  verb.add_option("--iteration", command->step,
                  "which model of a run: the one saved after this step [the newest]")
      ->type_name("STEP");
  add_time_option(verb, command->time,
                  "write this moment of Gaussians in space and time, 0 to 1, as 3D Gaussians");
  verb.add_flag("--table", command->table,
                "output is a folder: write every format into it, with a table of sizes and losses");
  verb.add_option("--title", command->title,
                  "what a page (.html) is called [the name of the scene's folder]")
      ->type_name("TEXT");
  verb.add_flag("--force", command->force, "if a file exists, move it to FILE.bak-N first");
  verb.add_option("--spz-version", command->options.spz_version,
                  "version of .spz files: 3, which Spark and splat-transform read, 2 for older "
                  "readers, with coarser rotations, or 4, which fewer programs read [3]")
      ->check(CLI::IsMember({2, 3, 4}))
      ->type_name("VERSION");
  verb.add_option("--spz-sh-bits", command->options.spz_sh_bits,
                  "bits of an SH coefficient in .spz files: 8 is the finest, and makes a larger "
                  "file [5 at degree 1, 4 beyond it]")
      ->check(CLI::Range(1, 8))
      ->type_name("BITS");
  verb.add_option("--duration", command->options.duration,
                  "duration of a scene that moves, in seconds: .gs4d files say it to players [not "
                  "known]")
      ->check(CLI::Range(0.0, 1e6))
      ->type_name("SECONDS");
  verb.add_option("--up", command->up,
                  "up direction in the model's axes; the model is turned so that it becomes -y, "
                  "which viewers show at the top [no turn]")
      ->delimiter(',')
      ->expected(3)
      ->type_name("X,Y,Z")
      ->group("Frame");
  verb.add_flag("--recenter", command->recenter, "move the median of the means to the origin")
      ->group("Frame");
  verb.add_option("--scale", command->scale, "scale the model by this factor [1]")
      ->check(CLI::Range(1e-6, 1e6))
      ->type_name("FACTOR")
      ->group("Frame");
  verb.add_option("--georef", command->georef,
                  "where the scene stands on earth [georef.json of the run's scene or of --data]")
      ->type_name("FILE")
      ->group("Frame");
  verb.add_option(
          "--tile-gaussians", command->tile_gaussians,
          fmt::format("Gaussians in a tile of a tileset at most [{}]", kTileGaussiansAtMost))
      ->check(CLI::Range(100, 1'000'000))
      ->type_name("N");
  verb.add_flag("--no-measure", command->unmeasured,
                "do not render pictures to measure the loss of lossy files");
  add_camera_options(verb, *command, "-d,--data,-s,--source-path");
  add_render_options(verb, *command, "highest SH degree in the files");
  add_general_options(verb, *command);
  verb.callback([command] { run_export(*command); });
}

}  // namespace gs
