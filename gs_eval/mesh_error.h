// SPDX-License-Identifier: Apache-2.0
// How far a surface is from a known one.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "gs_core/triangle_mesh.h"

namespace gs {

struct MeshErrorRule {
  std::size_t samples = 1000000;   // points on each of the two
  std::uint64_t seed = 0;          // of these points
  std::vector<double> thresholds;  // world units
};

/// Distances are those from points of one surface to the other surface itself, in world units.
struct MeshError {
  double accuracy = 0;      // the mean distance of the mesh from the truth
  double completeness = 0;  // the mean distance of the truth from the mesh
  double chamfer() const { return (accuracy + completeness) / 2; }

  // The mean |n . n'| of a point's normal and that of the nearest place on the other surface, over
  // both ways; none where one of the two has neither triangles nor normals.
  std::optional<double> normal_consistency;

  /// Shares of points that are at most so far from the other one.     Knapitsch et al. 2017
  struct Within {
    double threshold = 0;
    double precision = 0;  // of the mesh's points
    double recall = 0;     // of the truth's
    double f1() const {
      return precision + recall > 0 ? 2 * precision * recall / (precision + recall) : 0;
    }
  };
  std::vector<Within> within;  // one for each threshold
};

/// Takes points on triangles, as many to each area as to any other of its size, or evenly chosen
/// vertices of what has no triangles. The same points for the same seed, for any number of threads.
/// Both have at least one finite vertex, and an area above 0 where they have triangles.
MeshError mesh_error(const TriangleMesh& mesh, const TriangleMesh& truth,
                     const MeshErrorRule& rule);

/// The area of all triangles.   world units^2
double area_of(const TriangleMesh& mesh);

}  // namespace gs
