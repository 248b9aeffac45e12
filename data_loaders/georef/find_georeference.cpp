// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/georef/find_georeference.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "data_loaders/colmap/world_offset.h"
#include "gs_core/error.h"
#include "gs_core/geodesy/utm.h"
#include "gs_core/geometry/outliers.h"
#include "gs_core/math/render/rotation.h"

namespace gs {
namespace {

constexpr int kEarthCentered = 4978;        // EPSG
constexpr double kMostTurnError = 0.1;      // radians; a house of 20 m would lean 2 m
constexpr double kHighestCamera = 100'000;  // meters; beyond, the coordinates are of another system

/// Camera centers and places, pair by pair.
struct PlacedCameras {
  std::vector<std::string> names;
  std::vector<Vec3d> centers, ecef;
};

PlacedCameras placed_cameras(const ColmapModel& model, const GpsPlaces& places, double geoid) {
  PlacedCameras placed;
  for (const ColmapImage& image : model.images) {
    const auto found = places.find(image.name);
    if (found == places.end()) continue;
    Geodetic place = found->second;
    place.height += geoid;
    placed.names.push_back(image.name);
    placed.centers.push_back(center_of(image));
    placed.ecef.push_back(ecef_of(place));
  }
  return placed;
}

void check_count(const PlacedCameras& placed, const ColmapModel& model) {
  if (placed.names.size() >= 3) return;
  throw Error(fmt::format(
      "only {} of {} photos have a GPS place with a height, and three are needed; give places in a "
      "file (--gps FILE), or say what the scene's coordinates are (--crs or --origin)",
      placed.names.size(), model.images.size()));
}

void check_agreement(const std::optional<RobustSimilarity>& fit, const PlacedCameras& placed,
                     double most_distance) {
  const std::size_t fitting = fit ? fit->fit_count : 0;
  if (2 * fitting >= placed.names.size() && fitting >= 3) return;
  throw Error(
      fmt::format("{} of {} cameras fit their GPS places within {} m, and half of them must, but "
                  "not all on one "
                  "line; raise --max-distance, or give better places in a file (--gps FILE)",
                  fitting, placed.names.size(), most_distance));
}

void check_turn(const RobustSimilarity& fit) {
  if (fit.turn_error <= kMostTurnError) return;
  throw Error(
      fmt::format("the cameras are so near to one line that the errors of their GPS places (RMS "
                  "{:.2f} m) leave the turn about it open by {:.0f} degrees; add photos beside the "
                  "line, or give better places in a file (--gps FILE)",
                  fit.rms, fit.turn_error * 57.3));
}

std::vector<Vec3d> centers_of(const ColmapModel& model) {
  std::vector<Vec3d> centers;
  for (const ColmapImage& image : model.images) centers.push_back(center_of(image));
  return centers;
}

/// The similarity that takes `center` to the origin.
Similarity about(const Vec3d& center, double scale, const Mat3<double>& R) {
  return {scale, R, -scale * multiply(R, center)};
}

Georeference georeference_of_ecef(const Vec3d& center) {
  const Geodetic origin = geodetic_of(center);
  return {origin, about(center, 1, enu_from_ecef(origin))};
}

Georeference georeference_of_utm(const UtmZone& zone, const Vec3d& center, double geoid) {
  const UtmFrame frame = utm_frame_at(zone, center + Vec3d(0.0, 0.0, geoid));
  const double c = std::cos(frame.convergence), s = std::sin(frame.convergence);
  return {frame.place, about(center, 1 / frame.scale, {{c, s, 0}, {-s, c, 0}, {0, 0, 1}})};
}

bool is_in_utm(const Vec3d& at) {
  return at.x > 0 && at.x < 1e6 && at.y >= 0 && at.y <= 1e7;  // meters, all that zones hold
}

}  // namespace

GpsFit fit_to_gps(const ColmapModel& model, const GpsPlaces& places, const GpsFitOptions& options) {
  const PlacedCameras placed = placed_cameras(model, places, options.geoid_height);
  check_count(placed, model);
  const Geodetic origin = geodetic_of(median_position(placed.ecef));
  const Mat3<double> enu = enu_from_ecef(origin);
  std::vector<Vec3d> local;
  for (const Vec3d& at : placed.ecef) local.push_back(multiply(enu, at - ecef_of(origin)));
  const auto fit = fit_robust_similarity(placed.centers, local, {options.most_distance});
  check_agreement(fit, placed, options.most_distance);
  check_turn(*fit);
  GpsFit result{{origin, fit->to_from_from}, {placed.names.size(), fit->fit_count, fit->rms}, {}};
  for (std::size_t i = 0; i < placed.names.size(); ++i)
    if (!fit->fits[i]) result.outliers.push_back(placed.names[i]);
  return result;
}

Georeference georeference_of_epsg(const ColmapModel& model, int epsg, double geoid_height) {
  const auto zone = utm_zone_of_epsg(epsg);
  if (!zone && epsg != kEarthCentered)
    throw UsageError(fmt::format(
        "--crs EPSG:{} is not known; there are EPSG:4978 (earth-centered), and EPSG:32601 to 32660 "
        "and 32701 to 32760 (UTM, north and south); convert the camera positions to one of them",
        epsg));
  if (model.images.empty()) throw Error("the scene has no cameras; run COLMAP again");
  const Vec3d center = median_position(centers_of(model));
  const bool fits =
      zone ? is_in_utm(center) : std::abs(geodetic_of(center).height) < kHighestCamera;
  if (!fits || std::abs(zone ? center.z : 0) > kHighestCamera)
    throw Error(fmt::format(
        "the cameras stand about {}, which is nowhere in EPSG:{}; name the system of the scene's "
        "coordinates (--crs), or --origin if they are meters east, north and up of a place",
        text_of_offset(center), epsg));
  return zone ? georeference_of_utm(*zone, center, geoid_height) : georeference_of_ecef(center);
}

}  // namespace gs
