// SPDX-License-Identifier: Apache-2.0
// Floaters: Gaussians in the air between a camera and what it sees. Training makes them to fit
// photos of different brightness, or a view that no other view overlaps. They look right in that
// photo, but cover the picture when seen from beside it.
//
// A Gaussian is a floater only if the photos say so, by the sparse points that they show:
//
// seen through   A photo looks through a Gaussian if the sparse points around it in the picture lie
//                much farther away. With a clearance of 0.35 and points at 2 m, it looks through
//                Gaussians nearer than 0.7 m.
// witnesses      Another photo is a witness if it shows the Gaussian among its own points there, or
//                not far in front of them. It may be a branch that almost touches the first lens.
//
// Where a picture shows few points, as on a blank wall, nothing is known, and nothing is removed.
#pragma once

#include <cstdint>
#include <vector>

#include "gs_core/geometry/point_depths.h"
#include "gs_core/scene.h"
#include "gs_train/row_ops.h"
#include "gs_train/training_model.h"

namespace gs {

/// Finds floaters by the training photos of a scene.
class FloaterFinder {
 public:
  /// clearance   0: nothing is a floater
  /// witnesses   so many keep a Gaussian, at least 1
  FloaterFinder(const Scene& scene, float clearance, int witnesses = 1);
  /// (N) 1 for each floater.
  std::vector<std::uint8_t> marks(const std::vector<Vec3f>& means) const;

 private:
  float clearance_;
  int witnesses_;
  std::vector<PointDepths> views_;
};

/// Removes the floaters from a model that is synchronized, and returns their number. Uses memory of
/// the host alone.
std::size_t remove_floaters(TrainingModel& model, RowOps& rows, const FloaterFinder& finder);

}  // namespace gs
