// SPDX-License-Identifier: Apache-2.0
// gemsplat render: pictures and films of a trained model of any trainer, from given cameras or
// along a path.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <csignal>
#include <functional>
#include <map>
#include <memory>

#include "data_loaders/georef/georef_file.h"
#include "data_loaders/photos/photo_names.h"
#include "gs_app/export/cameras.h"
#include "gs_app/export/export_model.h"
#include "gs_app/export/orthophoto.h"
#include "gs_app/export/view_lens.h"
#include "gs_app/jobs/render/render_cameras.h"
#include "gs_app/jobs/render/render_job.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/photometric_file.h"
#include "gs_app/run/provenance.h"
#include "gs_app/run/text.h"
#include "gs_core/geometry/scene_frame.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/processes/signals.h"
#include "gs_core/system/version.h"

namespace gs {
namespace {

bool has_depth_in_colors(const RenderJob& job) {
  return job.shows(Quantity::depth) && (job.output.png || job.output.is_film());
}

DepthRange depth_range(const RenderJob& job, ViewPictures& pictures,
                       const std::vector<NamedCamera>& cameras) {
  if (!job.depth_range.empty()) return {job.depth_range[0], job.depth_range[1]};
  if (!has_depth_in_colors(job)) return {};
  return range_of(pictures.sample_depths(without_names(cameras)));
}

// --- Colors

// Gives the appearance of each picture, on a lens of its size; nothing where colors are neutral.
using LookOfCamera = std::function<std::unique_ptr<Appearance>(const NamedCamera&)>;

LookOfCamera look_of(const OpenedModel& opened, const RenderJob& job,
                     const std::vector<NamedCamera>& cameras) {
  if (job.like.empty()) return {};
  if (!opened.run || !std::filesystem::exists(opened.run->photometric()))
    throw UsageError(
        "--like needs a run that was trained with photometric.model, whose photometric.json says "
        "how its photos look; name such a run's folder, or leave --like out");
  const SceneLooks looks = read_photometric(opened.run->photometric());
  std::map<std::string, std::string> names;  // also without extension, as in cameras.json
  for (const auto& [name, photo] : looks.photos) names[without_extension(name)] = name;
  for (const auto& [name, photo] : looks.photos) names[name] = name;
  const auto photo_of = [like = job.like](const NamedCamera& camera) {
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

Json film_json(const RenderJob& job, const RenderOutput& output,
               const std::vector<NamedCamera>& cameras, const DepthRange& range) {
  Json json = {{"pictures", output.patterns()},
               {"cameras", output.cameras().filename().string()},
               {"frames", cameras.size()},
               {"fps", job.output.frames_per_second}};
  if (!output.codec().empty()) json["codec"] = output.codec();
  json["width"] = cameras[0].camera.width;
  json["height"] = cameras[0].camera.height;
  if (has_depth_in_colors(job)) json["depth_range"] = {range.nearest, range.farthest};
  if (job.shows(Quantity::normal)) json["normal_space"] = job.normal_space;
  if (!job.like.empty()) json["like"] = job.like;
  if (!job.lens.empty()) json["lens"] = job.lens;
  return json;
}

bool is_described(const RenderJob& job) { return job.is_path() || job.output.is_film(); }

// Descriptions of older pictures must not be beside newer ones, should a signal come.
void put_descriptions_aside(const RenderJob& job, const RenderOutput& output) {
  if (!is_described(job)) return;
  for (const auto& file : {output.cameras(), output.description()})
    if (std::filesystem::exists(file))
      log_info("the older {} is now {}", file.string(), move_aside(file).string());
}

void write_description(const RenderOutput& output, const std::vector<NamedCamera>& cameras,
                       const Json& json) {
  write_cameras_json(output.cameras(), cameras);
  write_text(output.description(), file_text(json));
}

std::vector<std::string> names_of(const std::vector<NamedCamera>& cameras) {
  std::vector<std::string> names;
  for (const NamedCamera& named : cameras) names.push_back(named.name);
  return names;
}

volatile std::sig_atomic_t g_is_interrupted = 0;

void render_views(const RenderJob& job, const std::vector<NamedCamera>& cameras,
                  const LookOfCamera& look_of, ViewPictures& pictures, RenderOutput& output,
                  JobEvents& events) {
  const SignalHandlers handlers([](int) { g_is_interrupted = 1; });
  if (!job.output.is_film()) put_descriptions_aside(job, output);
  const auto render_view = [&](std::size_t i) {
    if (g_is_interrupted)
      throw Error(
          fmt::format("stopped by a signal after {} of {} views; {}", i, cameras.size(),
                      job.output.is_film() ? "the film is left out" : "their pictures are kept"),
          ExitCode::interrupted);
    const std::vector<Quantity>& quantities = job.output.quantities;
    const std::unique_ptr<Appearance> look = look_of ? look_of(cameras[i]) : nullptr;
    if (job.output.is_color_in_8_bits() && !look && !job.is_panorama()) {
      output.write(i, Quantity::color, pictures.color(cameras[i].camera));
    } else {
      const std::vector<ImageF> values =
          job.is_panorama() ? panorama_values(pictures, cameras[i].camera, quantities)
                            : pictures.values(cameras[i].camera, quantities, look.get());
      for (std::size_t q = 0; q < values.size(); ++q) output.write(i, quantities[q], values[q]);
    }
    events.progress("rendered", "view", i + 1, cameras.size());
  };
  try {
    for (std::size_t i = 0; i < cameras.size(); ++i) render_view(i);
  } catch (...) {
    output.write_waiting();
    throw;
  }
  if (job.output.is_film()) put_descriptions_aside(job, output);
  output.finish();
}

// The description of a path or film, which is written beside it.
Json description_of(const RenderJob& job, const RenderOutput& output, const OpenedModel& opened,
                    const Config& config, const RenderSettings& settings,
                    const std::vector<NamedCamera>& cameras, const DepthRange& range,
                    const Json& path) {
  Json json = film_json(job, output, cameras, range);
  if (!path.is_null()) json["path"] = path;
  json["model"] = model_json(opened);
  json["settings"] = settings_json(config, settings);
  json["version"] = kVersion;
  json["commit"] = built_commit();
  json["date"] = utc_date();
  return json;
}

// --- Orthophotos

constexpr const char* kOrthophoto = "orthophoto";  // name of the picture

std::optional<Orthophoto> orthophoto_of(const RenderJob& job, const OpenedModel& opened,
                                        const Config& config,
                                        const std::vector<NamedCamera>& cameras) {
  if (!job.meters_per_pixel) return std::nullopt;
  const std::string& scene = config.dataset.source;
  const std::filesystem::path file =
      job.georef.empty() ? georef_file_of(scene) : std::filesystem::path(job.georef);
  if (job.georef.empty() && (scene.empty() || !std::filesystem::exists(file)))
    throw UsageError(
        "--meters-per-pixel needs to know where the scene stands on earth; run `gemsplat georef "
        "SCENE` first, or name its file with --georef FILE");
  return gs::orthophoto_of(read_georef(file), opened.model.gaussians.mean.span(),
                           without_names(cameras), opened.model.world_offset,
                           *job.meters_per_pixel);
}

// Beside each PNG.
std::vector<std::filesystem::path> world_files(const RenderJob& job) {
  std::vector<std::filesystem::path> files;
  const std::vector<Quantity>& quantities = job.output.quantities;
  if (job.output.png)
    for (const Quantity quantity : quantities)
      files.push_back(job.output.output /
                      (quantity == Quantity::color || quantities.size() == 1
                           ? fmt::format("{}.pgw", kOrthophoto)
                           : fmt::format("{}.{}.pgw", kOrthophoto, name_of(quantity))));
  return files;
}

std::string text_of(const Orthophoto& photo) {
  return fmt::format("{} x {} pixels; the coordinates of its world file are EPSG:{}{:02}\n",
                     photo.camera.width, photo.camera.height, photo.zone.is_south ? 327 : 326,
                     photo.zone.number);
}

Outcome outcome_of(const RenderJob& job, const OpenedModel& opened, std::size_t count) {
  const bool is_film = job.output.is_film();
  const std::string output = job.output.output.string();
  return {fmt::format("{} {} of {} in {}\n", count, is_film ? "frames" : "pictures",
                      opened.ply.string(), output),
          {{"output", output}, {"pictures", count}, {"model", opened.ply.string()}},
          {{"look at it", (is_film ? "xdg-open " : "ls ") + shell_word(output)}}};
}

}  // namespace

Outcome run(const RenderJob& given, JobEvents& events) {
  const RenderJob job = checked(given);
  OpenedModel opened = open_model(job.model, job.choice.step);
  // A cameras.json has the size of its pictures already; only -r makes them smaller.
  if (!job.has("dataset.source")) opened.config.dataset.resolution = 1;
  const Config config = resolve_to_work(job, opened.config);
  std::vector<NamedCamera> cameras = cameras_to_render(job, opened, config);
  if (cameras.empty())
    throw UsageError("there is no view to render; choose another --split, or --cameras");
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const Gaussians gaussians = copy_to(backend->memory(), opened.model);
  const RenderSettings settings = view_settings(opened, config);
  ViewPictures pictures(*backend, gaussians, opened.model.gaussians, settings,
                        job.normal_space == "camera");
  const SceneFrame frame = scene_frame(without_names(cameras), {});
  Json path;
  std::vector<float> key_times = {0, 1};
  if (!job.path_file.empty()) key_times = {cameras.front().camera.time, cameras.back().camera.time};
  if (job.is_path()) {
    FilmPath film =
        film_path(job.path, cameras, opened.model.gaussians.mean.span(), opened.model.world_offset);
    cameras = std::move(film.cameras);
    path = std::move(film.description);
    if (!job.path_file.empty()) path["file"] = job.path_file;
  }
  const std::optional<Orthophoto> orthophoto = orthophoto_of(job, opened, config, cameras);
  if (orthophoto)
    cameras = {{kOrthophoto, orthophoto->camera}};
  else
    fit_cameras(job, pictures, frame, cameras);
  set_times_of(job, opened.model.gaussians.has_time, key_times, cameras);
  const LookOfCamera look = look_of(opened, job, cameras);
  const DepthRange range = depth_range(job, pictures, cameras);
  RenderOutput output(job.output, names_of(cameras), range);
  if (is_described(job))
    for (const auto& file : {output.description(), output.cameras()})
      check_place(file, job.output.force);
  if (orthophoto)
    for (const auto& file : world_files(job)) check_place(file, job.output.force);
  render_views(job, cameras, look, pictures, output, events);
  if (orthophoto)
    for (const auto& file : world_files(job)) {
      if (std::filesystem::exists(file)) move_aside(file);
      write_text(file, world_file(*orthophoto));
    }
  if (is_described(job))
    write_description(output, cameras,
                      description_of(job, output, opened, config, settings, cameras, range, path));
  Outcome outcome = outcome_of(job, opened, cameras.size());
  if (orthophoto) outcome.text += text_of(*orthophoto);
  return outcome;
}

Verb render_verb() {
  return verb_of<RenderJob>(
      "render", VerbGroup::look,
      "Render pictures or a film of a trained model, from given cameras or along a path",
      {"render out/scene -o pictures --split test",
       "render out/scene -o film.mp4 --path orbit --seconds 8",
       "render out/scene -o depths --write color,depth --format png,exr"});
}

}  // namespace gs
