// SPDX-License-Identifier: Apache-2.0
// The options of gemsplat render.
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <utility>

#include "gs_app/export/key_frames.h"
#include "gs_app/jobs/render/render_job.h"
#include "gs_app/run/output_place.h"
#include "gs_core/math/constants.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string> kPathKinds = {"orbit", "spline", "flythrough"};
const std::vector<std::string> kViewLenses = {"fisheye", "equirectangular", "orthographic"};
constexpr double kWidestPinhole = 150;  // degrees
constexpr double kSeconds = 10;         // of a path, where nothing is said
constexpr double kMostFrames = 1e6;     // more is a mistake

// --- Checking

bool contains(const std::vector<std::string>& words, const std::string& word) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

PictureSize size_of(const std::string& text) {
  PictureSize size;
  char end = 0;
  const bool is_size =
      std::sscanf(text.c_str(), "%d%*1[xX]%d%c", &size.width, &size.height, &end) == 2;
  const auto fits = [](int side) { return side > 0 && side <= kMaxPictureSide; };
  if (!is_size || !fits(size.width) || !fits(size.height))
    throw UsageError(
        fmt::format("--size {}: give width and height in pixels, like 1280x720, up to {}", text,
                    kMaxPictureSide));
  return size;
}

// Flags that mean something on some paths only.
void check_path_options(const RenderJob& job) {
  const std::string& kind = job.path.kind;
  const std::string all = "orbit, spline, flythrough, FILE", through = "spline, flythrough";
  const std::pair<const char*, std::string> kinds_of[] = {
      {"--through", "spline"}, {"--loop", "spline"},  {"--keys", through},
      {"--pace", through},     {"--turns", "orbit"},  {"--elevation", "orbit"},
      {"--radius", "orbit"},   {"--center", "orbit"}, {"--frames", all},
      {"--seconds", all}};
  for (const auto& [flag, kinds] : kinds_of)
    if (job.was_given(flag) && (kind.empty() || kinds.find(kind) == kinds.npos))
      throw UsageError(fmt::format("{} works only with --path {}", flag, kinds));
}

// Flags that mean something with some lenses only.
void check_lens(const RenderJob& job) {
  const bool has_angle = job.lens.empty() || job.lens == "fisheye";
  if (job.field_of_view && !has_angle)
    throw UsageError(fmt::format("--fov does not go with --lens {}", job.lens));
  if (job.lens.empty() && job.field_of_view.value_or(0) > kWidestPinhole)
    throw UsageError(fmt::format("--fov {}: a pinhole shows up to {} degrees; add --lens fisheye",
                                 *job.field_of_view, kWidestPinhole));
  if (job.across && job.lens != "orthographic")
    throw UsageError("--across works only with --lens orthographic");
  if (job.meters_per_pixel &&
      (job.lens != "orthographic" || job.is_path() || job.across || job.size))
    throw UsageError(
        "--meters-per-pixel gives one picture from above; it needs --lens orthographic, and no "
        "--path, --across or --size");
  if (!job.georef.empty() && !job.meters_per_pixel)
    throw UsageError("--georef is for orthophotos; add --meters-per-pixel");
  if (!job.lens.empty() && contains(job.quantities, "normal"))
    throw UsageError("normals are known of pinholes alone; leave --lens or normal out");
  if (!job.is_panorama()) return;
  if (job.size && (job.size->width != 2 * job.size->height || job.size->height % 2 != 0))
    throw UsageError(fmt::format(
        "--size {}: a panorama is twice as wide as high, in even numbers, like 4096x2048",
        job.size_words));
  if (!job.like.empty())
    throw UsageError("--like shows photos, and none is a whole panorama; leave it out");
}

std::size_t frames_of(const RenderJob& job, double usual_seconds) {
  const double frames = job.frames
                            ? double(*job.frames)
                            : job.seconds.value_or(usual_seconds) * job.output.frames_per_second;
  if (!(frames < kMostFrames))
    throw UsageError(
        fmt::format("{:.0f} frames are too many; give fewer --seconds or --fps", frames));
  return std::max<std::size_t>(1, std::size_t(frames + 0.5));
}

// Takes a --path that is no word for a kind as a file of key frames. Returns the seconds of the
// path if no flag says them.
double take_path_file(RenderJob& job) {
  PathRequest& path = job.path;
  if (path.kind.empty() || contains(kPathKinds, path.kind)) return kSeconds;
  if (!fs::exists(path.kind))
    throw UsageError(
        fmt::format("--path {}: it is none of {}, and there is no such file of key frames",
                    path.kind, fmt::join(kPathKinds, ", ")));
  if (!job.cameras.empty() || !job.split.empty())
    throw UsageError("--path FILE has cameras of its own; leave --cameras and --split out");
  job.path_file = std::exchange(path.kind, kKeyFrames);
  const KeyFrames frames = read_key_frames(job.path_file, Vec3d(0.0));
  path.is_loop = frames.is_closed;
  path.pace = frames.pace;
  return frames.seconds;
}

// A path is a film where that can hold it and this build writes films.
fs::path usual_output(const RenderJob& job) {
  if (!job.is_path() || job.output.exr || !can_write_films())
    return new_place(beside(job.model, "-pictures"));
  std::vector<std::string> endings = {".mp4", ".json", ".cameras.json"};
  for (const std::string& quantity : quantity_names()) endings.push_back("." + quantity + ".mp4");
  return new_place(beside(job.model, "-film"), endings);
}

// --- Options

std::string check_turns(const std::string& word) {
  const double turns = std::atof(word.c_str());
  return turns == 0 || !std::isfinite(turns) ? "must be a number other than 0" : "";
}

std::string check_finite(const std::string& word) {
  return std::isfinite(std::atof(word.c_str())) ? "" : "must be a number";
}

void visit_path(RenderJob& job, OptionList& list) {
  PathRequest& path = job.path;
  const auto option = [&](const char* names, auto& value, const char* meaning) -> Option& {
    return list(names, value, meaning).group("Path");
  };
  option("--path", path.kind,
         "path of the camera: around the scene, through chosen cameras, through all of the scene, "
         "or through the key frames of a file that the viewer has saved")
      .takes("orbit|spline|flythrough|FILE")
      .suggests(kPathKinds);
  option("--frames", job.frames, "number of frames of the path [300]").takes("N").positive().rare();
  option("--seconds", job.seconds, "length of the path, at --fps [10]")
      .takes("S")
      .positive()
      .excludes("--frames");
  option("--through", path.through,
         "spline: cameras to pass, by name or number [--keys cameras, evenly chosen]")
      .takes("CAMERA,...")
      .commas()
      .rare();
  option("--keys", path.keys, "spline, flythrough: number of cameras to pass [12]")
      .takes("N")
      .between(2, 10000)
      .excludes("--through")
      .rare();
  option("--loop", path.is_loop, "spline: return to the first camera").rare();
  option("--pace", path.pace,
         "spline, flythrough: constant speed, or the same time between cameras [even]")
      .one_of({"even", "keys"})
      .rare();
  option("--turns", path.turns,
         "orbit: number of turns; negative: clockwise [1; to and fro if the photos were taken from "
         "one side]")
      .takes("N")
      .checked(check_turns)
      .rare();
  option("--elevation", path.elevation,
         "orbit: angle above the center, in degrees [that of the cameras]")
      .takes("DEGREES")
      .between(-89, 89)
      .rare();
  option("--radius", path.radius, "orbit: radius in world units [that of the cameras]")
      .takes("R")
      .positive()
      .rare();
  option("--center", job.center,
         "orbit: center, in the coordinates of the photos' poses [where the cameras look]")
      .takes("X Y Z")
      .count(3, 3)
      .checked(check_finite)
      .rare();
}

void visit_pictures(RenderJob& job, OptionList& list) {
  const auto option = [&](const char* names, auto& value, const char* meaning) -> Option& {
    return list(names, value, meaning).group("Pictures");
  };
  option("--write", job.quantities, "which pictures to write of each view [color]")
      .takes("color,depth,alpha,normal")
      .one_of(quantity_names())
      .commas();
  option("--format", job.formats,
         "png: pictures to look at; exr: exact values as 32-bit floats; or both [png]")
      .takes("png,exr")
      .one_of({"png", "exr"})
      .commas()
      .rare();
  option("--like", job.like,
         "show colors as this photo of a run with photometric.model does, under its exposure and "
         "white balance; each: every picture as the photo of its name [the scene's own colors]")
      .takes("PHOTO|each")
      .suggests({kLikeEach})
      .rare();
  option("--size", job.size_words, "size of the pictures [that of the cameras]")
      .takes("WxH")
      .excludes("--resolution");
  option("--lens", job.lens,
         "draw through another lens: an equidistant fisheye, a panorama of 360 degrees, parallel "
         "rays [that of the cameras]")
      .one_of(kViewLenses)
      .rare();
  option("--fov", job.field_of_view,
         "angle across the width of the pictures, in degrees, up to 150, or 340 of a fisheye [that "
         "of the cameras; 180 of a fisheye]")
      .takes("DEGREES")
      .between(1, 340)
      .rare();
  option("--across", job.across,
         "orthographic: width of the pictures in world units [as the cameras see the middle of "
         "their depths]")
      .takes("UNITS")
      .positive()
      .rare();
  option(
      "--meters-per-pixel", job.meters_per_pixel,
      "orthographic: an orthophoto straight from above, north up, with a world file (.pgw), of a "
      "georeferenced scene")
      .takes("METERS")
      .positive()
      .rare();
  option("--georef", job.georef,
         "of an orthophoto: where the scene stands on earth [georef.json of the run's scene or of "
         "--data]")
      .takes("FILE")
      .rare();
  option("--fps", job.output.frames_per_second, "frames per second of a film [30]")
      .takes("F")
      .between(0.1, 240)
      .rare();
  option("--time", job.times,
         "moment of Gaussians in space and time, 0 to 1, or those of the first and the last "
         "picture [those of the cameras; 0 1 for a --path]")
      .takes("T [T]")
      .count(1, 2)
      .between(0, 1)
      .rare();
  option("--depth-range", job.depth_range,
         "range of depths that pictures show in color, in world units [that of 98 % of the pixels]")
      .takes("NEAR FAR")
      .count(2, 2)
      .positive()
      .rare();
  option("--normal-space", job.normal_space,
         "axes of normals: those of the world, or right, up and towards the camera [world]")
      .one_of({"world", "camera"})
      .rare();
  option("--force", job.output.force, "if a file exists, move it to FILE.bak-N first");
}

}  // namespace

bool RenderJob::shows(Quantity quantity) const {
  return std::find(output.quantities.begin(), output.quantities.end(), quantity) !=
         output.quantities.end();
}

void visit_options(RenderJob& job, OptionList& option) {
  option("model", job.model, kModelHelp).takes("MODEL|RUN").required();
  option("-o,--output", job.output_path,
         "folder for pictures, named after their views, or a film whose name ends in .mp4 [beside "
         "the model: MODEL-pictures, or MODEL-film.mp4 of a --path]")
      .takes("FOLDER|FILM");
  model_options(option, job.choice);
  given_camera_options(option, job.cameras, "those of the run");
  option("--split", job.split, "which views of the run or of --data [all; train for a --path]")
      .one_of({"test", "train", "all"})
      .group("Scene");
  visit_path(job, option);
  visit_pictures(job, option);
  render_options(option);
  general_options(option);
}

// The request, checked as far as it can be without the model.
RenderJob checked(RenderJob job) {
  const double usual_seconds = take_path_file(job);
  check_path_options(job);
  job.path.frames = frames_of(job, usual_seconds);
  if (!job.center.empty()) job.path.center = Vec3d(job.center[0], job.center[1], job.center[2]);
  if (!job.size_words.empty()) job.size = size_of(job.size_words);
  check_lens(job);
  job.output.is_panorama = job.is_panorama();
  const auto& names = quantity_names();
  for (std::size_t i = 0; i < names.size(); ++i)
    if (contains(job.quantities, names[i])) job.output.quantities.push_back(Quantity(i));
  job.output.exr = contains(job.formats, "exr");
  job.output.png = job.formats.empty() || contains(job.formats, "png");
  job.output.output = job.output_path.empty() ? usual_output(job) : fs::path(job.output_path);
  check_output(job.output);
  const std::vector<float>& range = job.depth_range;
  if (!range.empty() && !(range[0] < range[1]))
    throw UsageError("--depth-range: give the nearer depth first");
  return job;
}

}  // namespace gs
