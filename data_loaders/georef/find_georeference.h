// SPDX-License-Identifier: Apache-2.0
// Where a scene stands on earth, found from GPS places of its photos, or from what its coordinates
// are: those of a UTM zone, or earth-centered (ECEF).
#pragma once

#include <string>
#include <vector>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/georef/georef_file.h"
#include "data_loaders/georef/gps_places.h"

namespace gs {

struct GpsFitOptions {
  double most_distance = 5;  // meters between a camera and its GPS place; phones are 3 to 5 off
  double geoid_height = 0;   // meters to add to the places' heights
};

/// A fit of a scene to the GPS places of its photos.
struct GpsFit {
  Georeference georeference;  // the origin is the median of the places
  GpsFitQuality quality;
  std::vector<std::string> outliers;  // photos that do not fit
};

/// Finds the similarity from the camera centers to the places that have their images' names. Throws
/// Error, with a remedy, for fewer than three places, where fewer than half of them agree, and
/// where the cameras are so near to a line that their turn about it is open.
GpsFit fit_to_gps(const ColmapModel& model, const GpsPlaces& places, const GpsFitOptions& options);

/// The georeference of a model whose coordinates are those of a coordinate system:
/// EPSG:4978 (earth-centered), EPSG:32601 to 32660 and 32701 to 32760 (UTM). The origin is the
/// median camera; in a UTM zone convergence and scale are those at the origin, also for heights.
/// `geoid_height` is added to the heights of UTM. Throws UsageError for other systems, and Error if
/// the cameras are not on earth.
Georeference georeference_of_epsg(const ColmapModel& model, int epsg, double geoid_height);

}  // namespace gs
