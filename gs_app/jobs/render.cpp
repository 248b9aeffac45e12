// SPDX-License-Identifier: Apache-2.0
// gemsplat render: pictures and films of a trained model of any trainer, from given cameras or
// along a path.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <csignal>
#include <functional>
#include <map>
#include <memory>

#include "data_loaders/photos/photo_names.h"
#include "gs_app/export/cameras.h"
#include "gs_app/export/export_model.h"
#include "gs_app/export/key_frames.h"
#include "gs_app/jobs/render/render_job.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/photometric_file.h"
#include "gs_app/run/provenance.h"
#include "gs_app/run/text.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/processes/signals.h"
#include "gs_core/system/version.h"

namespace gs {
namespace {

// --- Cameras

// The cameras of --cameras, of --data or of the run itself. A path follows training views unless
// --split or --through says otherwise.
std::vector<NamedCamera> cameras_of(const RenderJob& job, const OpenedModel& opened,
                                    const Config& config) {
  if (!job.path_file.empty()) return read_key_frames(job.path_file, opened.model.world_offset).keys;
  const int resolution = config.dataset.resolution;
  const Vec3d& offset = opened.model.world_offset;
  const bool has_split =
      job.has("dataset.source") || (opened.run && std::filesystem::exists(opened.run->split()));
  const bool follows_training = job.is_path() && job.path.through.empty() && has_split;
  const std::string split = !job.split.empty() ? job.split : follows_training ? "train" : "all";
  if (job.has("dataset.source")) return cameras_of_scene(config.dataset, split, offset);
  if (job.cameras.empty() && opened.run)
    return cameras_of_run(*opened.run, resolution, split, offset);
  if (job.cameras.empty())
    throw UsageError(
        "there are no cameras to render from; give --cameras with a cameras.json, a "
        "transforms.json or a COLMAP model, or --data SCENE");
  if (!job.split.empty() && job.split != "all")
    throw UsageError("--split goes with --data or a run, not with --cameras");
  return cameras_of_file(job.cameras, resolution, offset);
}

// Gives the cameras the size and lens of the command line. All frames of a film have the size of
// the first, and even sides, because H.264 stores one color for 2x2 pixels.
void fit_cameras(const RenderJob& job, std::vector<NamedCamera>& cameras) {
  const bool is_film = job.output.is_film();
  std::optional<PictureSize> size = job.size;
  if (is_film && !size) size = PictureSize{cameras[0].camera.width, cameras[0].camera.height};
  for (auto& [name, camera] : cameras) {
    const bool is_other = size && (size->width != camera.width || size->height != camera.height);
    if (is_other) camera = reframed(camera, size->width, size->height);
    if (job.field_of_view) camera = with_field_of_view(camera, *job.field_of_view);
  }
  if (!is_film || !size || (size->width % 2 == 0 && size->height % 2 == 0)) return;
  const PictureSize even{std::max(2, size->width & ~1), std::max(2, size->height & ~1)};
  log_info("films have even sides: {}x{} becomes {}x{}, without the last row or column",
           size->width, size->height, even.width, even.height);
  for (auto& [name, camera] : cameras) camera.width = even.width, camera.height = even.height;
}

// A path plays the scene from its begin to its end, if nothing else is said; one of key frames from
// the time of the first to that of the last, `key_times`.
void set_times(const RenderJob& job, bool has_time, const std::vector<float>& key_times,
               std::vector<NamedCamera>& cameras) {
  std::vector<float> times = job.times;
  if (!has_time && !times.empty())
    throw UsageError("the model holds 3D Gaussians, which have no time; leave --time out");
  if (has_time && times.empty() && job.is_path()) times = key_times;
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
    if (job.output.is_color_in_8_bits() && !look) {
      output.write(i, Quantity::color, pictures.color(cameras[i].camera));
    } else {
      const std::vector<ImageF> values = pictures.values(cameras[i].camera, quantities, look.get());
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
  std::vector<NamedCamera> cameras = cameras_of(job, opened, config);
  if (cameras.empty())
    throw UsageError("there is no view to render; choose another --split, or --cameras");
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  const Gaussians gaussians = copy_to(backend->memory(), opened.model);
  const RenderSettings settings = view_settings(opened, config);
  ViewPictures pictures(*backend, gaussians, opened.model.gaussians, settings,
                        job.normal_space == "camera");
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
  fit_cameras(job, cameras);
  set_times(job, opened.model.gaussians.has_time, key_times, cameras);
  const LookOfCamera look = look_of(opened, job, cameras);
  const DepthRange range = depth_range(job, pictures, cameras);
  RenderOutput output(job.output, names_of(cameras), range);
  if (is_described(job))
    for (const auto& file : {output.description(), output.cameras()})
      check_place(file, job.output.force);
  render_views(job, cameras, look, pictures, output, events);
  if (is_described(job))
    write_description(output, cameras,
                      description_of(job, output, opened, config, settings, cameras, range, path));
  return outcome_of(job, opened, cameras.size());
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
