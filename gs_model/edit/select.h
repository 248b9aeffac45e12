// SPDX-License-Identifier: Apache-2.0
// Which Gaussians lie where, how large they are and how well they can be seen. `gemsplat edit`
// chooses rows by these.
#pragma once

#include <limits>
#include <optional>

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/threads/parallel.h"

namespace gs {

/// (N) 1 for each Gaussian that is chosen.
using Marks = std::vector<std::uint8_t>;

/// Marks the rows for which `is_chosen(i)` is true. It is called from several threads.
template <class F>
Marks marks_where(std::size_t count, F&& is_chosen) {
  Marks marks(count);
  parallel_for(count, 4096, [&](std::size_t i) { marks[i] = is_chosen(i) ? 1 : 0; });
  return marks;
}

/// The rows whose mark is `value`, ascending.
std::vector<std::uint32_t> rows_marked(const Marks& marks, bool value = true);

/// The rows with the `count` largest scores, ascending; of equal ones the first. NaN is the
/// smallest.
std::vector<std::uint32_t> rows_with_largest(const std::vector<float>& scores, std::size_t count);

/// Numbers from `low` to `high`, both included. NaN lies in no interval.
struct Interval {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();

  bool holds(double value) const { return value >= low && value <= high; }
};

/// A box with its sides along the axes.
struct Box {
  Vec3d low, high;

  bool holds(const Vec3d& point) const;
};

/// The box with these two opposite corners, in any order.
Box box_between(const Vec3d& a, const Vec3d& b);

/// The smallest box around the finite means; all zero where there are none.
Box box_of_means(const Gaussians& gaussians);

/// Where the camera shows a point, also beside its picture; nothing where it cannot.   pixels
std::optional<Vec2f> pixel_in_sight(const Camera& camera, const Vec3f& point);

/// Whether a point is in front of the camera and inside its picture.
bool is_in_picture(const Camera& camera, const Vec3f& point);

/// (N) how far a Gaussian reaches along each axis, to both sides of its mean: three standard
/// deviations, which is as far as it is drawn. Gaussians without time.   world units
std::vector<Vec3f> reaches_of(const Gaussians& gaussians);

/// (N) the largest of a Gaussian's three standard deviations.   world units
std::vector<float> sizes_of(const Gaussians& gaussians);

/// (N) how much of a picture a Gaussian would cover from afar, averaged over all directions, if
/// nothing were in front of it: opacity times the surface of its ellipsoid, up to a factor.
///                                                                  world units^2
/// Gaussians without time and without a 3D filter (bake_filter.h).
std::vector<float> coverages_of(const Gaussians& gaussians);

/// (N) the distance of each mean from the nearest of the positions; infinite where there are none.
std::vector<float> distances_to_nearest(const Gaussians& gaussians,
                                        const std::vector<Vec3f>& positions);

}  // namespace gs
