// SPDX-License-Identifier: Apache-2.0
// gemsplat render: pictures and films of a trained model of any trainer, from given cameras or
// along a path.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <csignal>
#include <functional>
#include <iostream>
#include <map>
#include <memory>

#include "apps/cli/devices.h"
#include "apps/cli/render_command.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_app/export/cameras.h"
#include "gs_app/export/export_model.h"
#include "gs_app/export/key_frames.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/photometric_file.h"
#include "gs_app/run/progress_bar.h"
#include "gs_app/run/provenance.h"
#include "gs_core/error.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/processes/signals.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

// --- Cameras

// The cameras of --cameras, of --data or of the run itself. A path follows training views unless
// --split or --through says otherwise.
std::vector<NamedCamera> cameras_of(const RenderCommand& command, const OpenedModel& opened,
                                    const Config& config) {
  if (!command.path_file.empty())
    return read_key_frames(command.path_file, opened.model.world_offset).keys;
  const int resolution = config.dataset.resolution;
  const Vec3d& offset = opened.model.world_offset;
  const bool has_split =
      command.has("dataset.source") || (opened.run && std::filesystem::exists(opened.run->split()));
  const bool follows_training = command.is_path() && command.path.through.empty() && has_split;
  const std::string split = !command.split.empty() ? command.split
                            : follows_training     ? "train"
                                                   : "all";
  if (command.has("dataset.source")) return cameras_of_scene(config.dataset, split, offset);
  if (command.cameras.empty() && opened.run)
    return cameras_of_run(*opened.run, resolution, split, offset);
  if (command.cameras.empty())
    throw UsageError(
        "there are no cameras to render from; give --cameras with a cameras.json, a "
        "transforms.json or a COLMAP model, or --data SCENE");
  if (!command.split.empty() && command.split != "all")
    throw UsageError("--split goes with --data or a run, not with --cameras");
  return cameras_of_file(command.cameras, resolution, offset);
}

// Gives the cameras the size and lens of the command line. All frames of a film have the size of
// the first, and even sides, because H.264 stores one color for 2x2 pixels.
void fit_cameras(const RenderCommand& command, std::vector<NamedCamera>& cameras) {
  const bool is_film = command.output.is_film();
  std::optional<PictureSize> size = command.size;
  if (is_film && !size) size = PictureSize{cameras[0].camera.width, cameras[0].camera.height};
  for (auto& [name, camera] : cameras) {
    const bool is_other = size && (size->width != camera.width || size->height != camera.height);
    if (is_other) camera = reframed(camera, size->width, size->height);
    if (command.field_of_view) camera = with_field_of_view(camera, *command.field_of_view);
  }
  if (!is_film || !size || (size->width % 2 == 0 && size->height % 2 == 0)) return;
  const PictureSize even{std::max(2, size->width & ~1), std::max(2, size->height & ~1)};
  log_info("films have even sides: {}x{} becomes {}x{}, without the last row or column",
           size->width, size->height, even.width, even.height);
  for (auto& [name, camera] : cameras) camera.width = even.width, camera.height = even.height;
}

// A path plays the scene from its begin to its end, if nothing else is said; one of key frames from
// the time of the first to that of the last, `key_times`.
void set_times(const RenderCommand& command, bool has_time, const std::vector<float>& key_times,
               std::vector<NamedCamera>& cameras) {
  std::vector<float> times = command.times;
  if (!has_time && !times.empty())
    throw UsageError("the model holds 3D Gaussians, which have no time; leave --time out");
  if (has_time && times.empty() && command.is_path()) times = key_times;
  if (times.empty()) return;
  const float steps = float(std::max<std::size_t>(cameras.size(), 2) - 1);
  for (std::size_t i = 0; i < cameras.size(); ++i)
    cameras[i].camera.time = times[0] + (times.back() - times[0]) * (float(i) / steps);
}

std::vector<Camera> without_names(const std::vector<NamedCamera>& cameras) {
  std::vector<Camera> result;
  for (const NamedCamera& named : cameras) result.push_back(named.camera);
  return result;
}

bool has_depth_in_colors(const RenderCommand& command) {
  return command.shows(Quantity::depth) && (command.output.png || command.output.is_film());
}

DepthRange depth_range(const RenderCommand& command, ViewPictures& pictures,
                       const std::vector<NamedCamera>& cameras) {
  if (!command.depth_range.empty()) return {command.depth_range[0], command.depth_range[1]};
  if (!has_depth_in_colors(command)) return {};
  return range_of(pictures.sample_depths(without_names(cameras)));
}

// --- Colors

constexpr const char* kLikeEach = "each";  // --like: every picture as the photo of its own name

// Gives the appearance of each picture, on a lens of its size; nothing where colors are neutral.
using LookOfCamera = std::function<std::unique_ptr<Appearance>(const NamedCamera&)>;

LookOfCamera look_of(const OpenedModel& opened, const RenderCommand& command,
                     const std::vector<NamedCamera>& cameras) {
  if (command.like.empty()) return {};
  if (!opened.run || !std::filesystem::exists(opened.run->photometric()))
    throw UsageError(
        "--like needs a run that was trained with photometric.model, whose photometric.json says "
        "how its photos look; name such a run's folder, or leave --like out");
  const SceneLooks looks = read_photometric(opened.run->photometric());
  std::map<std::string, std::string> names;  // also without extension, as in cameras.json
  for (const auto& [name, photo] : looks.photos) names[without_extension(name)] = name;
  for (const auto& [name, photo] : looks.photos) names[name] = name;
  const auto photo_of = [like = command.like](const NamedCamera& camera) {
    return like == kLikeEach ? camera.name : like;
  };
  for (const NamedCamera& camera : cameras)
    if (!names.contains(photo_of(camera)))
      throw UsageError(fmt::format("there is no photo {} in {}; it has {} and others",
                                   photo_of(camera), opened.run->photometric().string(),
                                   looks.photos.empty() ? "none" : looks.photos.begin()->first));
  return [of = appearances(looks), names, photo_of](const NamedCamera& camera) {
    View view;
    view.name = names.at(photo_of(camera));
    view.camera = camera.camera;
    return of(view);
  };
}

// --- What was done

Json model_json(const OpenedModel& opened) {
  return {{"file", opened.ply.string()},
          {"gaussians", opened.model.gaussians.count()},
          {"sh_degree", opened.model.sh_degree}};
}

Json settings_json(const Config& config, const RenderSettings& settings) {
  return {{"background", {settings.background.x, settings.background.y, settings.background.z}},
          {"antialiased", config.render.antialias},
          {"blend_rule", std::string(word_of(config.render.blend_rule))},
          {"sh_degree", settings.sh_degree}};
}

Json film_json(const RenderCommand& command, const RenderOutput& output,
               const std::vector<NamedCamera>& cameras, const DepthRange& range) {
  Json json = {{"pictures", output.patterns()},
               {"cameras", output.cameras().filename().string()},
               {"frames", cameras.size()},
               {"fps", command.output.frames_per_second}};
  if (!output.codec().empty()) json["codec"] = output.codec();
  json["width"] = cameras[0].camera.width;
  json["height"] = cameras[0].camera.height;
  if (has_depth_in_colors(command)) json["depth_range"] = {range.nearest, range.farthest};
  if (command.shows(Quantity::normal)) json["normal_space"] = command.normal_space;
  if (!command.like.empty()) json["like"] = command.like;
  return json;
}

bool is_described(const RenderCommand& command) {
  return command.is_path() || command.output.is_film();
}

// Descriptions of older pictures must not be beside newer ones, should a signal come.
void put_descriptions_aside(const RenderCommand& command, const RenderOutput& output) {
  if (!is_described(command)) return;
  for (const auto& file : {output.cameras(), output.description()})
    if (std::filesystem::exists(file))
      log_info("the older {} is now {}", file.string(), move_aside(file).string());
}

void write_description(const RenderOutput& output, const std::vector<NamedCamera>& cameras,
                       const Json& json) {
  write_cameras_json(output.cameras(), cameras);
  write_text(output.description(), json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

std::vector<std::string> names_of(const std::vector<NamedCamera>& cameras) {
  std::vector<std::string> names;
  for (const NamedCamera& named : cameras) names.push_back(named.name);
  return names;
}

volatile std::sig_atomic_t g_is_interrupted = 0;

void render_views(const RenderCommand& command, const std::vector<NamedCamera>& cameras,
                  const LookOfCamera& look_of, ViewPictures& pictures, RenderOutput& output) {
  ProgressBar bar(std::int64_t(cameras.size()), !command.quiet);
  const SignalHandlers handlers([](int) { g_is_interrupted = 1; });
  if (!command.output.is_film()) put_descriptions_aside(command, output);
  const auto render_view = [&](std::size_t i) {
    if (g_is_interrupted)
      throw Error(fmt::format("stopped by a signal after {} of {} views; {}", i, cameras.size(),
                              command.output.is_film() ? "the film is left out"
                                                       : "their pictures are kept"),
                  ExitCode::interrupted);
    const std::vector<Quantity>& quantities = command.output.quantities;
    const std::unique_ptr<Appearance> look = look_of ? look_of(cameras[i]) : nullptr;
    if (command.output.is_color_in_8_bits() && !look) {
      output.write(i, Quantity::color, pictures.color(cameras[i].camera));
    } else {
      const std::vector<ImageF> values = pictures.values(cameras[i].camera, quantities, look.get());
      for (std::size_t q = 0; q < values.size(); ++q) output.write(i, quantities[q], values[q]);
    }
    if (bar.due(std::int64_t(i) + 1)) bar.draw(std::int64_t(i) + 1, cameras[i].name, "view");
  };
  try {
    for (std::size_t i = 0; i < cameras.size(); ++i) render_view(i);
  } catch (...) {
    output.write_waiting();
    throw;
  }
  bar.clear();
  if (command.output.is_film()) put_descriptions_aside(command, output);
  output.finish();
}

}  // namespace

bool RenderCommand::shows(Quantity quantity) const {
  return std::find(output.quantities.begin(), output.quantities.end(), quantity) !=
         output.quantities.end();
}

void render(const RenderCommand& command) {
  setup_log(command.verbosity());
  OpenedModel opened = open_model(command.model, command.step);
  // A cameras.json has the size of its pictures already; only -r makes them smaller.
  if (!command.has("dataset.source")) opened.config.dataset.resolution = 1;
  const Config config = resolve(command, opened.config);
  set_thread_count(config.train.threads);
  std::vector<NamedCamera> cameras = cameras_of(command, opened, config);
  if (cameras.empty())
    throw UsageError("there is no view to render; choose another --split, or --cameras");
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const Gaussians gaussians = copy_to(backend->memory(), opened.model);
  const RenderSettings settings = view_settings(opened, config);
  ViewPictures pictures(*backend, gaussians, opened.model.gaussians, settings,
                        command.normal_space == "camera");
  Json path;
  std::vector<float> key_times = {0, 1};
  if (!command.path_file.empty())
    key_times = {cameras.front().camera.time, cameras.back().camera.time};
  if (command.is_path()) {
    FilmPath film = film_path(command.path, cameras, opened.model.gaussians.mean.span(),
                              opened.model.world_offset);
    cameras = std::move(film.cameras);
    path = std::move(film.description);
    if (!command.path_file.empty()) path["file"] = command.path_file;
  }
  fit_cameras(command, cameras);
  set_times(command, opened.model.gaussians.has_time, key_times, cameras);
  const LookOfCamera look = look_of(opened, command, cameras);
  const DepthRange range = depth_range(command, pictures, cameras);
  RenderOutput output(command.output, names_of(cameras), range);
  if (is_described(command))
    for (const auto& file : {output.description(), output.cameras()})
      check_place(file, command.output.force);
  render_views(command, cameras, look, pictures, output);
  if (is_described(command)) {
    Json json = film_json(command, output, cameras, range);
    if (!path.is_null()) json["path"] = path;
    json["model"] = model_json(opened);
    json["settings"] = settings_json(config, settings);
    json["version"] = kVersion;
    json["commit"] = built_commit();
    json["date"] = utc_date();
    write_description(output, cameras, json);
  }
  if (!command.quiet)
    std::cout << cameras.size() << (command.output.is_film() ? " frames of " : " pictures of ")
              << opened.ply.string() << " in " << command.output.output.string() << "\n";
}

}  // namespace gs
