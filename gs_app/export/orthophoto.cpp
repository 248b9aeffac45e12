// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/orthophoto.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "gs_core/error.h"
#include "gs_core/math/constants.h"

namespace gs {
namespace {

constexpr double kBeyond = 0.01;  // share of the Gaussians beyond each side

/// The values at which that share is lower, and higher.
std::pair<double, double> range_of(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto beyond = std::size_t(kBeyond * double(values.size() - 1));
  return {values[beyond], values[values.size() - 1 - beyond]};
}

Mat3<double> transposed(const Mat3<double>& m) {
  return {{m.row0.x, m.row1.x, m.row2.x},
          {m.row0.y, m.row1.y, m.row2.y},
          {m.row0.z, m.row1.z, m.row2.z}};
}
Mat3<double> product(const Mat3<double>& a, const Mat3<double>& b) {
  const Mat3<double> columns = transposed(b);
  return transposed(
      {multiply(a, columns.row0), multiply(a, columns.row1), multiply(a, columns.row2)});
}

/// Input coordinates as meters of a UTM grid, exact at one place: (easting, northing, height above
/// that place), meters.
Similarity grid_from_input(const Georeference& georeference, const Vec3d& at, UtmZone& zone) {
  const Similarity& enu = georeference.enu_from_input;
  const Geodetic place = geodetic_of(georeference.ecef_of_input(at));
  zone = utm_zone_at(place);
  const Vec3d coordinates = utm_of(zone, place);
  const UtmFrame frame = utm_frame_at(zone, coordinates);
  const double c = std::cos(frame.convergence), s = std::sin(frame.convergence);
  const Mat3<double> grid_from_enu{{c, -s, 0}, {s, c, 0}, {0, 0, 1}};
  const Mat3<double> turned = product(enu_from_ecef(place), ecef_from_enu(georeference.origin).R);
  Similarity grid{frame.scale * enu.scale, product(product(grid_from_enu, turned), enu.R)};
  grid.shift = Vec3d(coordinates.x, coordinates.y, 0.0) - grid(at);
  return grid;
}

}  // namespace

Orthophoto orthophoto_of(const Georeference& georeference, Span<const Vec3f> means,
                         const std::vector<Camera>& cameras, const Vec3d& world_offset,
                         double meters_per_pixel) {
  GS_CHECK(!means.empty() && !cameras.empty());
  Vec3d middle(0.0);
  for (const Camera& camera : cameras) middle += Vec3d(camera.position()) / double(cameras.size());
  Orthophoto photo;
  photo.meters_per_pixel = meters_per_pixel;
  const Similarity grid = grid_from_input(georeference, middle + world_offset, photo.zone);
  std::vector<double> eastings, northings;
  for (const Vec3f& mean : means) {
    const Vec3d at = grid(Vec3d(mean) + world_offset);
    eastings.push_back(at.x);
    northings.push_back(at.y);
  }
  double top = -std::numeric_limits<double>::infinity();
  for (const Camera& camera : cameras)
    top = std::max(top, grid(Vec3d(camera.position()) + world_offset).z);
  const auto pixel_of = [&](double meters) { return std::floor(meters / meters_per_pixel); };
  const auto [west, east] = range_of(std::move(eastings));
  const auto [south, north] = range_of(std::move(northings));
  const double left = pixel_of(west), above = pixel_of(north);
  const double width = pixel_of(east) - left + 1, height = above - pixel_of(south) + 1;
  if (width > kMaxPictureSide || height > kMaxPictureSide)
    throw UsageError(
        fmt::format("--meters-per-pixel {}: the orthophoto would have {:.0f} x {:.0f} pixels, and "
                    "a picture has "
                    "{} a side at most; give more meters",
                    meters_per_pixel, width, height, kMaxPictureSide));
  photo.easting = (left + 0.5) * meters_per_pixel;
  photo.northing = (above + 0.5) * meters_per_pixel;

  Camera& camera = photo.camera;
  camera.width = int(width), camera.height = int(height);
  camera.fx = camera.fy = float(grid.scale / meters_per_pixel);
  camera.cx = 0.5f * float(width), camera.cy = 0.5f * float(height);
  camera.lens = endless_lens<float>(Lens::orthographic);
  camera.cam_from_world_rotation = {Vec3f(grid.R.row0), -Vec3f(grid.R.row1), -Vec3f(grid.R.row2)};
  const Vec3d eye((left + width / 2) * meters_per_pixel,
                  (above + 1 - height / 2) * meters_per_pixel, top);
  const Vec3d position = multiply_transposed(grid.R, eye - grid.shift) / grid.scale - world_offset;
  camera.cam_from_world_translation = Vec3f(-Vec3d(
      inner(grid.R.row0, position), -inner(grid.R.row1, position), -inner(grid.R.row2, position)));
  return photo;
}

std::string world_file(const Orthophoto& photo) {
  return fmt::format("{0:.10g}\n0\n0\n{1:.10g}\n{2:.6f}\n{3:.6f}\n", photo.meters_per_pixel,
                     -photo.meters_per_pixel, photo.easting, photo.northing);
}

}  // namespace gs
