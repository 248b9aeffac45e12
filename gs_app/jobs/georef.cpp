// SPDX-License-Identifier: Apache-2.0
// gemsplat georef: finds where a scene stands on earth, and writes georef.json for exports.
#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "data_loaders/georef/find_georeference.h"
#include "data_loaders/scene/place_scene.h"
#include "gs_app/export/export_model.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/output_place.h"
#include "gs_app/run/text.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/parse_number.h"

namespace gs {
namespace {

struct GeorefJob : JobSettings {
  std::string output, gps, crs, heights = "ellipsoid";
  std::vector<double> origin;  // longitude, latitude, height; empty: not given
  double most_distance = 5;    // meters
  std::optional<double> geoid;
  bool force = false;
};

void visit_options(GeorefJob& job, OptionList& option) {
  option.setting("scene,-s,--source-path,-d,--data", "dataset.source", "Scene");
  option.setting("--images", "dataset.images", "Scene").rare();
  option("-o,--output", job.output, "file to write [SCENE/georef.json]").takes("FILE");
  option("--force", job.force, "if the file exists, move it to FILE.bak-N first");
  option("--gps", job.gps,
         "take GPS places from this file, with lines NAME LATITUDE LONGITUDE HEIGHT [the EXIF tags "
         "of the photos]")
      .takes("FILE")
      .group("Place");
  option("--crs", job.crs,
         "the scene's coordinates are those of this system: EPSG:326NN or EPSG:327NN (UTM, north "
         "and south), EPSG:4978 (earth-centered)")
      .takes("EPSG:CODE")
      .group("Place");
  option("--origin", job.origin,
         "the scene's coordinates are meters east, north and up of this place")
      .takes("LON,LAT,HEIGHT")
      .count(3, 3)
      .commas()
      .group("Place");
  option("--max-distance", job.most_distance,
         "ignore cameras farther than this from their GPS position, in meters [5]")
      .takes("METERS")
      .between(0.001, 10'000)
      .group("Place");
  option("--heights", job.heights,
         "heights are above the ellipsoid of WGS 84, or above sea level [ellipsoid]")
      .one_of({"ellipsoid", "sea-level"})
      .group("Place");
  option("--geoid", job.geoid,
         "height of sea level above the ellipsoid there; with --heights sea-level")
      .takes("METERS")
      .between(-120, 120)
      .group("Place");
  general_options(option);
}

constexpr std::size_t kOutliersShown = 10;

bool is_above_sea(const GeorefJob& job) { return job.heights == "sea-level"; }

void check(const GeorefJob& job) {
  if (!job.crs.empty() + !job.origin.empty() + !job.gps.empty() > 1)
    throw UsageError("--gps, --crs and --origin are three ways to say where a scene is; give one");
  if (is_above_sea(job) != job.geoid.has_value())
    throw UsageError(
        "--heights sea-level and --geoid METERS belong together: METERS is the height of sea level "
        "above the ellipsoid there, -107 to 86");
}

std::string text_of_heights(const GeorefJob& job) {
  return is_above_sea(job) ? fmt::format("above sea level, which is {} m above the ellipsoid",
                                         job.geoid.value_or(0))
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

GeorefFile by_origin(const GeorefJob& job) {
  const Geodetic origin{job.origin[0], job.origin[1], job.origin[2] + job.geoid.value_or(0)};
  if (!is_on_earth(origin))
    throw UsageError(
        "--origin is not LONGITUDE,LATITUDE,HEIGHT of a place on earth, in degrees "
        "and meters");
  return {{origin, {}}, "an origin"};
}

GeorefFile by_gps(const GeorefJob& job, const ColmapModel& model, const SceneFolders& folders) {
  GpsPlaces places;
  if (job.gps.empty()) {
    std::vector<std::string> names;
    for (const ColmapImage& image : model.images) names.push_back(image.name);
    places = gps_places_of_photos(names, match_photos(names, folders.images));
  } else {
    places = read_gps_file(job.gps);
  }
  const GpsFit fit = fit_to_gps(model, places, {job.most_distance, job.geoid.value_or(0)});
  for (std::size_t i = 0; i < std::min(fit.outliers.size(), kOutliersShown); ++i)
    log_warning("{} does not fit its GPS place", shown_word(fit.outliers[i]));
  if (fit.outliers.size() > kOutliersShown)
    log_warning("nor do {} more photos", fit.outliers.size() - kOutliersShown);
  return {fit.georeference, fmt::format("GPS of {} photos", fit.quality.cameras), "", fit.quality};
}

GeorefFile georeference_of(const GeorefJob& job, const Config& config) {
  const SceneFolders folders = find_scene(config.dataset);
  const ColmapModel model = read_scene(config.dataset, folders).model;
  GeorefFile file;
  if (!job.origin.empty())
    file = by_origin(job);
  else if (!job.crs.empty())
    file = {georeference_of_epsg(model, epsg_of(job.crs), job.geoid.value_or(0)), job.crs};
  else
    file = by_gps(job, model, folders);
  file.heights = text_of_heights(job);
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

Json json_of(const std::filesystem::path& path, const GeorefFile& file) {
  const Geodetic& origin = file.georeference.origin;
  Json json = {{"file", path.string()},
               {"longitude", origin.longitude},
               {"latitude", origin.latitude},
               {"height", origin.height},
               {"meters_per_unit", file.georeference.enu_from_input.scale}};
  if (const auto& quality = file.quality)
    json["gps"] = {
        {"cameras", quality->cameras}, {"fitting", quality->fitting}, {"rms", quality->rms}};
  return json;
}

Outcome run(const GeorefJob& job, JobEvents&) {
  const Config config = resolve(job);
  if (config.dataset.source.empty())
    throw UsageError("there is no scene; give its folder: gemsplat georef SCENE");
  check(job);
  const std::filesystem::path path =
      job.output.empty() ? georef_file_of(config.dataset.source).string() : job.output;
  if (job.output.empty()) say_place(path);
  const OutputLock lock = OutputLock::of_file(path);
  check_place(path, job.force);
  const GeorefFile file = georeference_of(job, config);
  if (!is_above_sea(job) && job.crs != "EPSG:4978")
    log_info(
        "heights are taken as heights above the ellipsoid; if they are above sea level, add "
        "--heights sea-level --geoid METERS");
  keep_older_aside(path);
  write_georef(path, file);
  const std::string place = job.output.empty() ? "" : " --georef " + shell_word(job.output);
  return {summary_of(path, file, job.most_distance),
          json_of(path, file),
          {{"show it on a map", "gemsplat export RUN tiles/" + place}}};
}

}  // namespace

Verb georef_verb() {
  return verb_of<GeorefJob>(
      "georef", VerbGroup::change, "Find where a scene stands on earth, for exports to maps",
      {"georef scene", "georef scene --crs EPSG:32633", "georef scene --origin 8.54,47.38,410"});
}

}  // namespace gs
