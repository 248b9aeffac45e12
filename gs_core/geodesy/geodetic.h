// SPDX-License-Identifier: Apache-2.0
// Places on earth, on the ellipsoid of WGS 84: longitude, latitude and height; earth-centered
// coordinates (ECEF, EPSG:4978); and the local frame east, north, up.
#pragma once

#include "gs_core/types.h"

namespace gs {

inline constexpr double kEarthAxis = 6378137;                  // a, meters: the equator's radius
inline constexpr double kEarthFlattening = 1 / 298.257223563;  // f = 1 - b / a

/// A place. The height is above the ellipsoid, which is not the height above sea level: the geoid
/// lies between 107 m below and 86 m above it.
struct Geodetic {
  double longitude = 0, latitude = 0;  // degrees; east and north are positive
  double height = 0;                   // meters
};

/// Whether all numbers are finite, and within 180 and 90 degrees and 1e6 meters.
bool is_on_earth(const Geodetic& place);

/// Earth-centered coordinates: x to longitude 0 on the equator, z to the north pole.   meters
///
///   o = ((N + h) cos phi cos lambda, (N + h) cos phi sin lambda, (N (1 - e^2) + h) sin phi),
///   N = a / sqrt(1 - e^2 sin^2 phi),  e^2 = f (2 - f)
Vec3d ecef_of(const Geodetic& place);

/// The opposite direction, for places within 1000 km of the ellipsoid: the reduced latitude of
/// Bowring 1976, repeated until it stands still. The longitude of a pole is 0.
Geodetic geodetic_of(const Vec3d& ecef);

/// The rows are the unit vectors east, north and up of a place in the earth-centered frame: the
/// matrix turns vectors of that frame into the local one.
Mat3<double> enu_from_ecef(const Geodetic& place);

}  // namespace gs
