// SPDX-License-Identifier: Apache-2.0
// gemsplat georef: finds where a scene stands on earth, and writes georef.json for exports.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <memory>

#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "data_loaders/georef/find_georeference.h"
#include "data_loaders/scene/place_scene.h"
#include "gs_app/export/export_model.h"
#include "gs_core/error.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/parse_number.h"

namespace gs {
namespace {

struct GeorefCommand : CommandLine {
  std::string output, gps, crs, heights = "ellipsoid";
  std::vector<double> origin;  // empty: not given
  double most_distance = 5, geoid = 0;
  bool force = false, has_geoid = false;
};

constexpr std::size_t kOutliersShown = 10;

bool is_above_sea(const GeorefCommand& command) { return command.heights == "sea-level"; }

void check(const GeorefCommand& command) {
  if (!command.crs.empty() + !command.origin.empty() + !command.gps.empty() > 1)
    throw UsageError("--gps, --crs and --origin are three ways to say where a scene is; give one");
  if (is_above_sea(command) != command.has_geoid)
    throw UsageError(
        "--heights sea-level and --geoid METERS belong together: METERS is the height of sea level "
        "above the ellipsoid there, -107 to 86");
}

std::string text_of_heights(const GeorefCommand& command) {
  return is_above_sea(command)
             ? fmt::format("above sea level, which is {} m above the ellipsoid", command.geoid)
             : "above the ellipsoid";
}

int epsg_of(const std::string& crs) {
  std::string_view number = crs;
  for (const std::string_view prefix : {"EPSG:", "epsg:"})
    if (number.starts_with(prefix)) number.remove_prefix(prefix.size());
  int code = 0;
  if (!parse_number(number, code))
    throw UsageError("--crs " + crs + " is not of the form EPSG:32633");
  return code;
}

GeorefFile by_origin(const GeorefCommand& command) {
  const Geodetic origin{command.origin[0], command.origin[1], command.origin[2] + command.geoid};
  if (!is_on_earth(origin))
    throw UsageError(
        "--origin is not LONGITUDE,LATITUDE,HEIGHT of a place on earth, in degrees "
        "and meters");
  return {{origin, {}}, "an origin"};
}

GeorefFile by_gps(const GeorefCommand& command, const ColmapModel& model,
                  const SceneFolders& folders) {
  GpsPlaces places;
  if (command.gps.empty()) {
    std::vector<std::string> names;
    for (const ColmapImage& image : model.images) names.push_back(image.name);
    places = gps_places_of_photos(names, match_photos(names, folders.images));
  } else {
    places = read_gps_file(command.gps);
  }
  const GpsFit fit = fit_to_gps(model, places, {command.most_distance, command.geoid});
  for (std::size_t i = 0; i < std::min(fit.outliers.size(), kOutliersShown); ++i)
    log_warning("{} does not fit its GPS place", shown_word(fit.outliers[i]));
  if (fit.outliers.size() > kOutliersShown)
    log_warning("nor do {} more photos", fit.outliers.size() - kOutliersShown);
  return {fit.georeference, fmt::format("GPS of {} photos", fit.quality.cameras), "", fit.quality};
}

GeorefFile georeference_of(const GeorefCommand& command, const Config& config) {
  const SceneFolders folders = find_scene(config.dataset);
  const ColmapModel model = read_scene(config.dataset, folders).model;
  GeorefFile file;
  if (!command.origin.empty())
    file = by_origin(command);
  else if (!command.crs.empty())
    file = {georeference_of_epsg(model, epsg_of(command.crs), command.geoid), command.crs};
  else
    file = by_gps(command, model, folders);
  file.heights = text_of_heights(command);
  return file;
}

std::string summary_of(const std::filesystem::path& path, const GeorefFile& file, double most) {
  const Geodetic& origin = file.georeference.origin;
  std::string text = path.string() + ": ";
  if (const auto& quality = file.quality)
    text += fmt::format("{} of {} cameras fit their GPS places within {} m, RMS {:.2f} m; ",
                        quality->fitting, quality->cameras, most, quality->rms);
  return text +
         fmt::format(
             "one unit of the scene is {:.6g} m; the origin is at longitude {:.7f}, latitude "
             "{:.7f}, {:.2f} m above the ellipsoid\n",
             file.georeference.enu_from_input.scale, origin.longitude, origin.latitude,
             origin.height);
}

void georef(const GeorefCommand& command) {
  setup_log(command.verbosity());
  const Config config = resolve(command);
  if (config.dataset.source.empty())
    throw UsageError("there is no scene; give its folder: gemsplat georef SCENE");
  check(command);
  const std::filesystem::path path =
      command.output.empty() ? georef_file_of(config.dataset.source).string() : command.output;
  const OutputLock lock = OutputLock::of_file(path);
  check_place(path, command.force);
  const GeorefFile file = georeference_of(command, config);
  if (!is_above_sea(command) && command.crs != "EPSG:4978")
    log_info(
        "heights are taken as heights above the ellipsoid; if they are above sea level, add "
        "--heights sea-level --geoid METERS");
  keep_older_aside(path);
  write_georef(path, file);
  if (!command.quiet) std::cout << summary_of(path, file, command.most_distance);
}

void add_source_options(CLI::App& verb, GeorefCommand& command) {
  verb.add_option("--gps", command.gps,
                  "take GPS places from this file, with lines NAME LATITUDE LONGITUDE HEIGHT [the "
                  "EXIF tags of the photos]")
      ->type_name("FILE")
      ->group("Place");
  verb.add_option("--crs", command.crs,
                  "the scene's coordinates are those of this system: EPSG:326NN or EPSG:327NN "
                  "(UTM, north and south), EPSG:4978 (earth-centered)")
      ->type_name("EPSG:CODE")
      ->group("Place");
  verb.add_option("--origin", command.origin,
                  "the scene's coordinates are meters east, north and up of this place")
      ->delimiter(',')
      ->expected(3)
      ->type_name("LON,LAT,HEIGHT")
      ->group("Place");
  verb.add_option("--max-distance", command.most_distance,
                  "ignore cameras farther than this from their GPS position, in meters [5]")
      ->check(CLI::Range(0.001, 10'000.0))
      ->type_name("METERS")
      ->group("Place");
  verb.add_option("--heights", command.heights,
                  "heights are above the ellipsoid of WGS 84, or above sea level [ellipsoid]")
      ->check(CLI::IsMember({"ellipsoid", "sea-level"}))
      ->type_name("ellipsoid|sea-level")
      ->group("Place");
  verb.add_option("--geoid", command.geoid,
                  "height of sea level above the ellipsoid there; with --heights sea-level")
      ->check(CLI::Range(-120.0, 120.0))
      ->type_name("METERS")
      ->group("Place");
}

}  // namespace

void add_georef(CLI::App& program) {
  CLI::App& verb =
      *program.add_subcommand("georef", "Find where a scene stands on earth, for exports to maps");
  const auto command = std::make_shared<GeorefCommand>();
  CommandLine& line = *command;
  add_setting(verb, line, "scene,-s,--source-path,-d,--data", "dataset.source", "Scene");
  add_setting(verb, line, "--images", "dataset.images", "Scene");
  verb.add_option("-o,--output", command->output, "file to write [SCENE/georef.json]")
      ->type_name("FILE");
  verb.add_flag("--force", command->force, "if the file exists, move it to FILE.bak-N first");
  add_source_options(verb, *command);
  add_general_options(verb, line);
  verb.callback([command, &verb] {
    command->has_geoid = verb.count("--geoid") > 0;
    georef(*command);
  });
}

}  // namespace gs
