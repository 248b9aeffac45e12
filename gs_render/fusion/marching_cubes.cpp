// SPDX-License-Identifier: Apache-2.0
#include "gs_render/fusion/marching_cubes.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

// --- The triangles of a cell

using Corners = std::array<int, 4>;  // of a face, counterclockwise from outside
using CellTriangles = std::vector<std::array<int, 3>>;

constexpr int bit_of(int axis) { return 1 << axis % 3; }

int edge_between(int a, int b) {
  const int low = std::min(a, b), axis = std::countr_zero(unsigned(a ^ b));
  return 4 * axis + (low & bit_of(axis + 1) ? 1 : 0) + (low & bit_of(axis + 2) ? 2 : 0);
}
/// The corner at which an edge begins.
int first_corner(int edge) {
  const int axis = edge / 4;
  return (edge & 1 ? bit_of(axis + 1) : 0) | (edge & 2 ? bit_of(axis + 2) : 0);
}

std::array<Corners, 6> faces_of_cell() {
  std::array<Corners, 6> faces;
  for (int axis = 0; axis < 3; ++axis) {
    const int u = bit_of(axis + 1), v = bit_of(axis + 2);
    faces[std::size_t(2 * axis)] = {0, v, u | v, u};
    for (std::size_t k = 0; k < 4; ++k)
      faces[std::size_t(2 * axis + 1)][k] = faces[std::size_t(2 * axis)][3 - k] | bit_of(axis);
  }
  return faces;
}

/// Whether two edges lie in one face: each of a cell's edges is that of two corners.
bool share_face(int edge_a, int edge_b) {
  const int a = first_corner(edge_a), b = first_corner(edge_b);
  for (int axis = 0; axis < 3; ++axis)
    if (axis != edge_a / 4 && axis != edge_b / 4 && (a & bit_of(axis)) == (b & bit_of(axis)))
      return true;
  return false;
}

/// Cuts a polygon into triangles by edges that lie in no face. False where there is no such way.
bool cut_polygon(const std::vector<int>& polygon, CellTriangles& triangles) {
  const std::size_t count = polygon.size();
  for (std::size_t i = 0; i < count; ++i) {
    const int before = polygon[(i + count - 1) % count], behind = polygon[(i + 1) % count];
    if (count > 3 && share_face(before, behind)) continue;
    triangles.push_back({before, polygon[i], behind});
    if (count == 3) return true;
    std::vector<int> rest = polygon;
    rest.erase(rest.begin() + std::ptrdiff_t(i));
    if (cut_polygon(rest, triangles)) return true;
    triangles.pop_back();
  }
  return false;
}

CellTriangles triangles_of_cell(unsigned solid) {
  const auto is_solid = [&](const Corners& face, std::size_t k) {
    return (solid >> face[k % 4] & 1) != 0;
  };
  // On each face, from the edge where a row of solid corners begins to the one where it ends.
  std::array<int, 12> next;
  next.fill(-1);
  for (const Corners& face : faces_of_cell())
    for (std::size_t k = 0; k < 4; ++k) {
      if (is_solid(face, k) || !is_solid(face, k + 1)) continue;
      std::size_t last = k + 1;
      while (is_solid(face, last + 1)) ++last;
      next[std::size_t(edge_between(face[k], face[(k + 1) % 4]))] =
          edge_between(face[last % 4], face[(last + 1) % 4]);
    }
  CellTriangles triangles;
  for (int& start : next) {
    std::vector<int> polygon;
    for (int* edge = &start; *edge >= 0;) {
      polygon.push_back(*edge);
      edge = &next[std::size_t(std::exchange(*edge, -1))];
    }
    if (!polygon.empty()) GS_CHECK(cut_polygon(polygon, triangles));
  }
  return triangles;
}

// --- A block

constexpr int kPadded = kBlockEdge + 1;  // voxels of a block and the first ones behind it
constexpr std::size_t kNoBlock = std::numeric_limits<std::size_t>::max();

/// Which edges of a block's voxels, towards x, y and z, the surface crosses. They have vertices, in
/// this order.
struct CrossedEdges {
  std::array<std::uint64_t, 3 * kBlockVoxels / 64> bits{};
  std::uint32_t first = 0;  // vertex of the first one

  void set(int edge) { bits[std::size_t(edge / 64)] |= std::uint64_t(1) << edge % 64; }
  bool has(int edge) const { return bits[std::size_t(edge / 64)] >> edge % 64 & 1; }
  std::uint32_t count() const { return rank(3 * kBlockVoxels) - first; }
  /// The vertex of a crossed edge.
  std::uint32_t rank(int edge) const {
    std::uint32_t sum = first;
    for (int word = 0; word < edge / 64; ++word)
      sum += std::uint32_t(std::popcount(bits[std::size_t(word)]));
    if (edge % 64)
      sum += std::uint32_t(std::popcount(bits[std::size_t(edge / 64)] << (64 - edge % 64)));
    return sum;
  }
};

int voxel_index(int x, int y, int z) { return (z * kBlockEdge + y) * kBlockEdge + x; }

/// A block with the first voxels of the seven blocks behind it.
class PaddedBlock {
 public:
  PaddedBlock(const Volume& volume, std::size_t block) {
    const VolumeFrame& frame = volume.frame;
    const std::uint64_t key = volume.keys[block];
    for (int n = 0; n < 8; ++n) {
      const std::uint64_t x = frame.place(key, 0) + (n & 1), y = frame.place(key, 1) + (n >> 1 & 1),
                          z = frame.place(key, 2) + (n >> 2);
      behind_[n] = kNoBlock;
      if (x >= frame.blocks[0] || y >= frame.blocks[1] || z >= frame.blocks[2]) continue;
      const std::uint64_t other = frame.key(x, y, z);
      const auto found =
          std::lower_bound(volume.keys.begin() + std::ptrdiff_t(block), volume.keys.end(), other);
      if (found != volume.keys.end() && *found == other)
        behind_[n] = std::size_t(found - volume.keys.begin());
    }
    for (int z = 0, i = 0; z < kPadded; ++z)
      for (int y = 0; y < kPadded; ++y)
        for (int x = 0; x < kPadded; ++x, ++i) {
          const std::size_t of = block_of(x, y, z);
          values_[i] = of == kNoBlock
                           ? std::nanf("")
                           : volume.distance[of * kBlockVoxels + std::size_t(inner_index(x, y, z))];
        }
  }

  float at(int x, int y, int z) const { return values_[(z * kPadded + y) * kPadded + x]; }
  /// The block that has a voxel, which may be one behind this one, and its place there.
  std::size_t block_of(int x, int y, int z) const {
    return behind_[x / kBlockEdge + 2 * (y / kBlockEdge) + 4 * (z / kBlockEdge)];
  }
  static int inner_index(int x, int y, int z) {
    return voxel_index(x % kBlockEdge, y % kBlockEdge, z % kBlockEdge);
  }

 private:
  std::size_t behind_[8];
  float values_[kPadded * kPadded * kPadded];
};

/// Calls visit(edge, value at its begin, value at its end, x, y, z, axis) for the edges of a block's
/// voxels that the surface crosses.
template <class Visit>
void for_crossings(const PaddedBlock& block, Visit&& visit) {
  for (int z = 0; z < kBlockEdge; ++z)
    for (int y = 0; y < kBlockEdge; ++y)
      for (int x = 0; x < kBlockEdge; ++x)
        for (int axis = 0; axis < 3; ++axis) {
          const float a = block.at(x, y, z),
                      b = block.at(x + (axis == 0), y + (axis == 1), z + (axis == 2));
          if (std::isnan(a) || std::isnan(b) || (a < 0) == (b < 0)) continue;
          visit(3 * voxel_index(x, y, z) + axis, a, b, Vec3f(float(x), float(y), float(z)), axis);
        }
}

/// The triangles of the cells that begin in a block.
std::vector<Triangle> block_triangles(const PaddedBlock& block,
                                      const std::vector<CrossedEdges>& crossed) {
  std::vector<Triangle> triangles;
  for (int i = 0; i < kBlockVoxels; ++i) {
    const int x = i % kBlockEdge, y = i / kBlockEdge % kBlockEdge, z = i / kBlockEdge / kBlockEdge;
    unsigned solid = 0;
    bool is_known = true;
    for (int c = 0; c < 8; ++c) {
      const float value = block.at(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2));
      is_known &= !std::isnan(value);
      solid |= unsigned(value < 0) << c;
    }
    if (!is_known) continue;
    for (const std::array<int, 3>& edges : cell_triangles(solid)) {
      Triangle triangle;
      for (std::size_t k = 0; k < 3; ++k) {
        const int c = first_corner(edges[k]);
        const int at[] = {x + (c & 1), y + (c >> 1 & 1), z + (c >> 2)};
        triangle[k] = crossed[block.block_of(at[0], at[1], at[2])].rank(
            3 * PaddedBlock::inner_index(at[0], at[1], at[2]) + edges[k] / 4);
      }
      triangles.push_back(triangle);
    }
  }
  return triangles;
}

}  // namespace

const std::vector<std::array<int, 3>>& cell_triangles(unsigned solid) {
  static const std::vector<CellTriangles> all = [] {
    std::vector<CellTriangles> cases;
    for (unsigned s = 0; s < 256; ++s) cases.push_back(triangles_of_cell(s));
    return cases;
  }();
  return all[solid];
}

TriangleMesh surface_of(const Volume& volume) {
  constexpr float kLeastShare = 1e-3f;  // of an edge, so that no two vertices meet in a voxel
  const std::size_t blocks = volume.keys.size();
  std::vector<CrossedEdges> crossed(blocks);
  parallel_for(blocks, 16, [&](std::size_t b) {
    for_crossings(PaddedBlock(volume, b), [&](int edge, auto...) { crossed[b].set(edge); });
  });
  std::uint64_t vertices = 0;
  for (CrossedEdges& edges : crossed) {
    const std::uint32_t count = edges.count();
    edges.first = std::uint32_t(vertices);
    vertices += count;
    if (vertices > std::numeric_limits<std::uint32_t>::max())
      throw Error("the mesh has more than 2^32 vertices; give a larger --voxel",
                  ExitCode::out_of_memory);
  }
  TriangleMesh mesh;
  mesh.vertices.resize(vertices);
  std::vector<std::vector<Triangle>> triangles(blocks);
  parallel_for(blocks, 16, [&](std::size_t b) {
    if (crossed[b].count() == 0) return;
    const PaddedBlock block(volume, b);
    const Vec3f low = volume.frame.corner(volume.keys[b]);
    std::uint32_t vertex = crossed[b].first;
    for_crossings(block, [&](int, float from, float to, Vec3f at, int axis) {
      at[axis] += clamp_to(from / (from - to), kLeastShare, 1 - kLeastShare);
      mesh.vertices[vertex++] = low + volume.frame.voxel * at;
    });
  });
  parallel_for(blocks, 16, [&](std::size_t b) {
    triangles[b] = block_triangles(PaddedBlock(volume, b), crossed);
  });
  for (const std::vector<Triangle>& some : triangles)
    mesh.triangles.insert(mesh.triangles.end(), some.begin(), some.end());
  return mesh;
}

}  // namespace gs
