// SPDX-License-Identifier: Apache-2.0
// Places that users give in words, and whether a Gaussian lies in one.
#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "gs_model/edit/places/words.h"

namespace gs {

/// The two axes of the plane in which polygons lie: x = 0, y = 1, z = 2.
struct PolygonPlane {
  int first = 0, second = 2;  // the floor of a model whose up is y
};
/// "xz", "xy", "yz" and so on. Throws UsageError.
PolygonPlane polygon_plane(std::string_view word);

/// How places are meant.
struct PlaceOptions {
  PolygonPlane plane;
  // Whether all of a Gaussian has to be inside, to three standard deviations, or its mean alone. It
  // counts for boxes, spheres, polygons and ranges of coordinates.
  bool whole = false;
};

/// Whether a place holds a Gaussian: its mean, and all that is within `reach` of it along each
/// axis. A reach of 0 asks for the mean alone.
using Place = std::function<bool(const Vec3d& mean, const Vec3d& reach)>;

/// Places by their words; `what` begins the message of the UsageError that they throw. A sphere is
/// asked about the corners of the box around a Gaussian, and a polygon about nine points of it.
Place box_of(const std::string& what, std::string_view values);
Place sphere_of(const std::string& what, std::string_view values);
Place polygon_of(std::string_view file, PolygonPlane plane);
Place range_of_axis(int axis, const Interval& range);

}  // namespace gs
