// SPDX-License-Identifier: Apache-2.0
// A picture of a georeferenced model straight from above, of which each pixel has a place on the map.
#pragma once

#include <string>
#include <vector>

#include "gs_core/buffer.h"
#include "gs_core/camera.h"
#include "gs_core/geodesy/georeference.h"
#include "gs_core/geodesy/utm.h"

namespace gs {

struct Orthophoto {
  Camera camera;             // parallel rays; right is the grid's east, the top its north
  UtmZone zone;              // of the picture's middle
  double meters_per_pixel;   // of the grid
  double easting, northing;  // meters, of the center of the first pixel
};

/// The orthophoto of nearly all Gaussians: one in a hundred may lie beyond each side. It shows what
/// is below the highest camera. Throws UsageError where it would have too many pixels.
///
/// means, cameras  of a model whose coordinates are those of the photos' poses minus world_offset
Orthophoto orthophoto_of(const Georeference& georeference, Span<const Vec3f> means,
                         const std::vector<Camera>& cameras, const Vec3d& world_offset,
                         double meters_per_pixel);

/// Its world file (.pgw), six lines: the width of a pixel, two turns of 0, the negative height of a
/// pixel, easting and northing.
std::string world_file(const Orthophoto& photo);

}  // namespace gs
