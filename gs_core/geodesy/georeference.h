// SPDX-License-Identifier: Apache-2.0
// Where a scene stands on earth.
#pragma once

#include "gs_core/geodesy/geodetic.h"
#include "gs_core/geometry/similarity.h"

namespace gs {

/// From meters east, north and up of a place to earth-centered coordinates.
inline Similarity ecef_from_enu(const Geodetic& place) {
  const auto [east, north, up] = enu_from_ecef(place);
  return {1,
          {{east.x, north.x, up.x}, {east.y, north.y, up.y}, {east.z, north.z, up.z}},
          ecef_of(place)};
}

/// A place, and how the coordinates of the photos' poses ("input": train + world offset) become
/// meters east, north and up of it.
struct Georeference {
  Geodetic origin;
  Similarity enu_from_input;

  Vec3d ecef_of_input(const Vec3d& input) const {
    return ecef_from_enu(origin)(enu_from_input(input));
  }
};

}  // namespace gs
