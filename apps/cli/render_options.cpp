// SPDX-License-Identifier: Apache-2.0
// The flags of gemsplat render.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <utility>

#include "apps/cli/render_command.h"
#include "apps/cli/verbs.h"
#include "gs_app/export/key_frames.h"
#include "gs_core/error.h"
#include "gs_core/math/constants.h"

namespace gs {
namespace {

const std::vector<std::string> kPathKinds = {"orbit", "spline", "flythrough"};
constexpr double kSeconds = 10;      // of a path, where nothing is said
constexpr double kMostFrames = 1e6;  // more is a mistake

/// Flags as CLI11 reads them; values that have to be parsed further go into the command.
struct RenderFlags {
  RenderCommand command;
  std::string output, size;
  std::vector<std::string> quantities = {"color"}, formats;
  std::vector<double> center;
  std::optional<double> seconds;
  std::optional<int> frames;
};

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
void check_path_flags(const CLI::App& verb, const std::string& kind) {
  const std::string all = "orbit, spline, flythrough, FILE", through = "spline, flythrough";
  const std::pair<const char*, std::string> kinds_of[] = {
      {"--through", "spline"}, {"--loop", "spline"},  {"--keys", through},
      {"--pace", through},     {"--turns", "orbit"},  {"--elevation", "orbit"},
      {"--radius", "orbit"},   {"--center", "orbit"}, {"--frames", all},
      {"--seconds", all}};
  for (const auto& [flag, kinds] : kinds_of)
    if (verb.count(flag) > 0 && (kind.empty() || kinds.find(kind) == kinds.npos))
      throw UsageError(fmt::format("{} works only with --path {}", flag, kinds));
}

std::size_t frames_of(const RenderFlags& flags, double usual_seconds) {
  const double frames =
      flags.frames ? double(*flags.frames)
                   : flags.seconds.value_or(usual_seconds) * flags.command.output.frames_per_second;
  if (!(frames < kMostFrames))
    throw UsageError(
        fmt::format("{:.0f} frames are too many; give fewer --seconds or --fps", frames));
  return std::max<std::size_t>(1, std::size_t(frames + 0.5));
}

// Takes a --path that is no word for a kind as a file of key frames. Returns the seconds of the
// path if no flag says them.
double take_path_file(RenderCommand& command) {
  PathRequest& path = command.path;
  if (path.kind.empty() || contains(kPathKinds, path.kind)) return kSeconds;
  if (!std::filesystem::exists(path.kind))
    throw UsageError(
        fmt::format("--path {}: it is none of {}, and there is no such file of key frames",
                    path.kind, fmt::join(kPathKinds, ", ")));
  if (!command.cameras.empty() || !command.split.empty())
    throw UsageError("--path FILE has cameras of its own; leave --cameras and --split out");
  command.path_file = std::exchange(path.kind, kKeyFrames);
  const KeyFrames frames = read_key_frames(command.path_file, Vec3d(0.0));
  path.is_loop = frames.is_closed;
  path.pace = frames.pace;
  return frames.seconds;
}

RenderCommand checked(const CLI::App& verb, const RenderFlags& flags) {
  RenderCommand command = flags.command;
  const double usual_seconds = take_path_file(command);
  check_path_flags(verb, command.path.kind);
  command.path.frames = frames_of(flags, usual_seconds);
  if (!flags.center.empty())
    command.path.center = Vec3d(flags.center[0], flags.center[1], flags.center[2]);
  if (!flags.size.empty()) command.size = size_of(flags.size);
  command.output.output = flags.output;
  const auto& names = quantity_names();
  for (std::size_t i = 0; i < names.size(); ++i)
    if (contains(flags.quantities, names[i])) command.output.quantities.push_back(Quantity(i));
  command.output.exr = contains(flags.formats, "exr");
  command.output.png = flags.formats.empty() || contains(flags.formats, "png");
  check_output(command.output);
  const std::vector<float>& range = command.depth_range;
  if (!range.empty() && !(range[0] < range[1]))
    throw UsageError("--depth-range: give the nearer depth first");
  return command;
}

// --- Options

void add_path_options(CLI::App& verb, RenderFlags& flags) {
  PathRequest& path = flags.command.path;
  verb.add_option(
          "--path", path.kind,
          "path of the camera: around the scene, through chosen cameras, through all of the "
          "scene, or through the key frames of a file that the viewer has saved")
      ->type_name("orbit|spline|flythrough|FILE")
      ->group("Path");
  verb.add_option("--frames", flags.frames, "number of frames of the path [300]")
      ->type_name("N")
      ->check(CLI::PositiveNumber)
      ->group("Path");
  verb.add_option("--seconds", flags.seconds, "length of the path, at --fps [10]")
      ->type_name("S")
      ->check(CLI::PositiveNumber)
      ->excludes("--frames")
      ->group("Path");
  verb.add_option("--through", path.through,
                  "spline: cameras to pass, by name or number [--keys cameras, evenly chosen]")
      ->delimiter(',')
      ->type_name("CAMERA,...")
      ->group("Path");
  verb.add_option("--keys", path.keys, "spline, flythrough: number of cameras to pass [12]")
      ->check(CLI::Range(2, 10000))
      ->type_name("N")
      ->excludes("--through")
      ->group("Path");
  verb.add_flag("--loop", path.is_loop, "spline: return to the first camera")->group("Path");
  verb.add_option("--pace", path.pace,
                  "spline, flythrough: constant speed, or the same time between cameras [even]")
      ->check(CLI::IsMember({"even", "keys"}))
      ->type_name("even|keys")
      ->group("Path");
  verb.add_option("--turns", path.turns,
                  "orbit: number of turns; negative: clockwise [1; to and fro if the photos were "
                  "taken from one side]")
      ->type_name("N")
      ->check([](const std::string& text) {
        const double turns = std::atof(text.c_str());
        return turns == 0 || !std::isfinite(turns) ? "must be a number other than 0" : "";
      })
      ->group("Path");
  verb.add_option("--elevation", path.elevation,
                  "orbit: angle above the center, in degrees [that of the cameras]")
      ->type_name("DEGREES")
      ->check(CLI::Range(-89.0, 89.0))
      ->group("Path");
  verb.add_option("--radius", path.radius, "orbit: radius in world units [that of the cameras]")
      ->type_name("R")
      ->check(CLI::PositiveNumber)
      ->group("Path");
  verb.add_option("--center", flags.center,
                  "orbit: center, in the coordinates of the photos' poses [where the cameras look]")
      ->type_name("X Y Z")
      ->expected(3)
      ->check([](const std::string& text) {
        return std::isfinite(std::atof(text.c_str())) ? "" : "must be a number";
      })
      ->group("Path");
}

void add_picture_options(CLI::App& verb, RenderFlags& flags) {
  RenderCommand& command = flags.command;
  verb.add_option("--write", flags.quantities, "which pictures to write of each view [color]")
      ->delimiter(',')
      ->check(CLI::IsMember(quantity_names()))
      ->type_name("color,depth,alpha,normal")
      ->group("Pictures");
  verb.add_option("--format", flags.formats,
                  "png: pictures to look at; exr: exact values as 32-bit floats; or both [png]")
      ->delimiter(',')
      ->check(CLI::IsMember({"png", "exr"}))
      ->type_name("png,exr")
      ->group("Pictures");
  verb.add_option("--like", command.like,
                  "show colors as this photo of a run with photometric.model does, under its "
                  "exposure and white balance; each: every picture as the photo of "
                  "its name [the scene's own colors]")
      ->type_name("PHOTO|each")
      ->group("Pictures");
  verb.add_option("--size", flags.size, "size of the pictures [that of the cameras]")
      ->type_name("WxH")
      ->excludes("--resolution")
      ->group("Pictures");
  verb.add_option("--fov", command.field_of_view,
                  "angle across the width of the pictures, in degrees [that of the cameras]")
      ->type_name("DEGREES")
      ->check(CLI::Range(1.0, 150.0))
      ->group("Pictures");
  verb.add_option("--fps", command.output.frames_per_second, "frames per second of a film [30]")
      ->type_name("F")
      ->check(CLI::Range(0.1, 240.0))
      ->group("Pictures");
  verb.add_option("--time", command.times,
                  "moment of Gaussians in space and time, 0 to 1, or those of the first and the "
                  "last picture [those of the cameras; 0 1 for a --path]")
      ->type_name("T [T]")
      ->expected(1, 2)
      ->check(CLI::Range(0.0, 1.0))
      ->group("Pictures");
  verb.add_option("--depth-range", command.depth_range,
                  "range of depths that pictures show in color, in world units [that of 98 % of "
                  "the pixels]")
      ->type_name("NEAR FAR")
      ->expected(2)
      ->check(CLI::PositiveNumber)
      ->group("Pictures");
  verb.add_option(
          "--normal-space", command.normal_space,
          "axes of normals: those of the world, or right, up and towards the camera [world]")
      ->check(CLI::IsMember({"world", "camera"}))
      ->type_name("world|camera")
      ->group("Pictures");
  verb.add_flag("--force", command.output.force, "if a file exists, move it to FILE.bak-N first")
      ->group("Pictures");
}

}  // namespace

void add_render(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "render", "Render pictures or a film of a trained model, from given cameras or along a path");
  const auto flags = std::make_shared<RenderFlags>();
  RenderCommand& command = flags->command;
  verb.add_option("model", command.model, kModelHelp)->type_name("MODEL|RUN")->required();
  verb.add_option("-o,--output", flags->output,
                  "folder for pictures, named after their views, or a film whose name ends in .mp4")
      ->type_name("FOLDER|FILM")
      ->required();
  verb.add_option("--iteration", command.step,
                  "which model of a run: the one saved after this step [the newest]")
      ->type_name("STEP");
  verb.add_option(
          "--cameras", command.cameras,
          "cameras.json, transforms.json or the folder of a COLMAP model [those of the run]")
      ->type_name("FILE|FOLDER")
      ->group("Scene");
  add_camera_options(verb, command, "-d,--data,-s,--source-path");
  verb.get_option("--data")->excludes("--cameras");
  verb.add_option("--split", command.split,
                  "which views of the run or of --data [all; train for a --path]")
      ->check(CLI::IsMember({"test", "train", "all"}))
      ->type_name("")
      ->group("Scene");
  add_path_options(verb, *flags);
  add_picture_options(verb, *flags);
  add_render_options(verb, command);
  add_general_options(verb, command);
  verb.callback([&verb, flags] { render(checked(verb, *flags)); });
}

}  // namespace gs
