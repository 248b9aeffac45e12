// SPDX-License-Identifier: Apache-2.0
// Where a scene stands on earth.
#pragma once

#include "gs_core/geodesy/geodetic.h"
#include "gs_core/geometry/similarity.h"

namespace gs {

/// A place, and how the coordinates of the photos' poses ("input": train + world offset) become
/// metres east, north and up of it.
struct Georeference {
  Geodetic origin;
  Similarity enu_from_input;

  Vec3d ecef_of_input(const Vec3d& input) const {
    return ecef_of(origin) + multiply_transposed(enu_from_ecef(origin), enu_from_input(input));
  }
};

}  // namespace gs
