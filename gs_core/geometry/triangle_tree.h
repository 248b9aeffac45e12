// SPDX-License-Identifier: Apache-2.0
// The nearest triangle, for distances from a surface.
#pragma once

#include <vector>

#include "gs_core/triangle_mesh.h"

namespace gs {

/// A tree of boxes over the triangles of a mesh, or over the vertices of one that has no triangles.
/// The mesh has either, all finite, and must stay in place while the tree lives.
class TriangleTree {
 public:
  explicit TriangleTree(const TriangleMesh& mesh);

  struct Nearest {
    float distance2;      // squared, world units^2
    std::uint32_t index;  // of the triangle, or of the vertex
  };
  /// What is nearest to a finite point.
  Nearest nearest(const Vec3f& point) const;

 private:
  struct Box {
    Vec3f low, high;
  };
  std::array<Vec3f, 3> corners(std::uint32_t item) const;
  void build(std::size_t node, std::size_t begin, std::size_t end);
  void search(std::size_t node, std::size_t begin, std::size_t end, const Vec3f& point,
              Nearest& best) const;

  const TriangleMesh& mesh_;
  std::vector<std::uint32_t> order_;  // each node has a range of it, and its children the halves
  std::vector<Box> boxes_;            // node n has the children 2 n + 1 and 2 n + 2
};

}  // namespace gs
