// SPDX-License-Identifier: Apache-2.0
// georef.json: where a scene stands on earth. `gemsplat georef` writes it, exports read it.
//
//   "version": 1
//   "source"           what it was made from: "GPS of 40 photos", "EPSG:32633", ...
//   "heights"          how the heights of the source were taken
//   "origin"           [longitude, latitude, height]: degrees, degrees, meters above the ellipsoid
//   "enu_from_input"   4x4 by rows: from the coordinates of the photos' poses to meters east, north
//                      and up of the origin
//   "cameras", "cameras_that_fit", "rms_m"   of a fit to GPS places alone
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "gs_core/geodesy/georeference.h"

namespace gs {

/// How well cameras fit their GPS places.
struct GpsFitQuality {
  std::size_t cameras = 0, fitting = 0;
  double rms = 0;  // meters, of those that fit
};

/// What a georef.json says.
struct GeorefFile {
  Georeference georeference;
  std::string source, heights = {};
  std::optional<GpsFitQuality> quality = {};
};

/// The file of a scene: georef.json in its folder.
std::filesystem::path georef_file_of(const std::filesystem::path& scene);

/// Writes the file, whole or not at all; throws Error.
void write_georef(const std::filesystem::path& path, const GeorefFile& file);

/// Reads what an export needs. Throws Error, with the file and a remedy, for a damaged file, one of
/// a newer version, an origin that is not on earth, and a matrix that is no similarity.
Georeference read_georef(const std::filesystem::path& path);

}  // namespace gs
