// SPDX-License-Identifier: Apache-2.0
// Where photos were taken, as GPS has it.
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "gs_core/geodesy/geodetic.h"

namespace gs {

/// Places by names of images.
using GpsPlaces = std::map<std::string, Geodetic>;

/// The places in the EXIF tags of photos. `names` are those of the images, `photos` their files,
/// empty where one is missing. Photos without tags are left out. Throws Error for a photo that
/// cannot be read, and in a build without OpenImageIO.
GpsPlaces gps_places_of_photos(const std::vector<std::string>& names,
                               const std::vector<std::filesystem::path>& photos);

/// The places in a text file as `colmap model_aligner --ref_is_gps 1` takes it, a line for each
/// photo; empty lines and those that begin with # do not count.
///
///   NAME LATITUDE LONGITUDE HEIGHT          degrees, degrees, meters
///
/// Throws Error, with the file, the line and a remedy.
GpsPlaces read_gps_file(const std::filesystem::path& path);

}  // namespace gs
