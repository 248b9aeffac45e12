// SPDX-License-Identifier: Apache-2.0
// Universal Transverse Mercator on WGS 84 (EPSG:32601 to 32660 in the north, 32701 to 32760 in the
// south), from its coordinates to places on earth and back.
#pragma once

#include <optional>

#include "gs_core/geodesy/geodetic.h"

namespace gs {

struct UtmZone {
  int number = 0;  // 1 to 60; its central meridian is 6 number - 183 degrees
  bool is_south = false;
};

/// The zone of an EPSG code such as 32633; none for other codes.
std::optional<UtmZone> utm_zone_of_epsg(int code);

/// The place with these coordinates (easting, northing, height above the ellipsoid), meters. Good
/// to less than a micrometer within 3900 km of the central meridian:
///
///   xi = xi' + ..., the series of Krueger 1912 in the third flattening n, to order 6, with the
///   coefficients beta of Karney 2011 (Transverse Mercator with an accuracy of a few nanometers,
///   Eq. 36), then the latitude of the conformal one by Newton's method (Eqs. 19 to 21)
Geodetic geodetic_of_utm(const UtmZone& zone, const Vec3d& coordinates);

/// The zone of a place, by its longitude alone.
UtmZone utm_zone_at(const Geodetic& place);

/// The coordinates of a place in a zone that contains it or is next to its own: those that
/// geodetic_of_utm() takes there, by Newton's method, good to a micrometer.
Vec3d utm_of(const UtmZone& zone, const Geodetic& place);

/// How the frame of a zone lies in the frame east, north, up at a place of it.
struct UtmFrame {
  Geodetic place;
  double convergence = 0;  // radians from true north to the grid's north, clockwise
  double scale = 1;        // meters of the grid in a meter at that height; 0.9996 in the middle
};

/// The frame at these coordinates. The projection is conformal, so one angle and one scale describe
/// it; both come from finite differences.
UtmFrame utm_frame_at(const UtmZone& zone, const Vec3d& coordinates);

}  // namespace gs
