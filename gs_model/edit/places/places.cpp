// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/places/places.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "gs_core/error.h"
#include "gs_model/edit/places/polygon_file.h"

namespace gs {

PolygonPlane polygon_plane(std::string_view word) {
  constexpr std::string_view kAxes = "xyz";
  const auto axis = [&](std::size_t i) {
    return i < word.size() ? kAxes.find(word[i]) : kAxes.npos;
  };
  if (word.size() != 2 || axis(0) == kAxes.npos || axis(1) == kAxes.npos || axis(0) == axis(1))
    throw UsageError(fmt::format("{} is no plane; name two axes, such as xz or xy", word));
  return {int(axis(0)), int(axis(1))};
}

Place box_of(const std::string& what, std::string_view values) {
  const std::vector<double> c = numbers_of_list(values, 6, what);
  const Box box = box_between({c[0], c[1], c[2]}, {c[3], c[4], c[5]});
  return [box](const Vec3d& p, const Vec3d& reach) {
    return box.holds(p - reach) && box.holds(p + reach);
  };
}

Place sphere_of(const std::string& what, std::string_view values) {
  const std::vector<double> c = numbers_of_list(values, 4, what);
  if (!(c[3] > 0)) throw UsageError(what + ": the radius must be above 0");
  return [center = Vec3d{c[0], c[1], c[2]}, r = c[3]](const Vec3d& p, const Vec3d& reach) {
    Vec3d far = p - center;  // the farthest corner of the box around the Gaussian
    for (int axis = 0; axis < 3; ++axis) far[axis] = std::abs(far[axis]) + reach[axis];
    return inner(far, far) <= r * r;
  };
}

Place polygon_of(std::string_view file, PolygonPlane plane) {
  return [area = read_polygon(file), plane](const Vec3d& p, const Vec3d& reach) {
    for (const double a : {-1.0, 0.0, 1.0})  // corners, middles of sides, and the mean
      for (const double b : {-1.0, 0.0, 1.0})
        if (!area.holds({p[plane.first] + a * reach[plane.first],
                         p[plane.second] + b * reach[plane.second]}))
          return false;
    return true;
  };
}

Place range_of_axis(int axis, const Interval& range) {
  return [axis, range](const Vec3d& p, const Vec3d& reach) {
    return range.holds(p[axis] - reach[axis]) && range.holds(p[axis] + reach[axis]);
  };
}

}  // namespace gs
