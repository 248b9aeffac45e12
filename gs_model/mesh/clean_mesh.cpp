// SPDX-License-Identifier: Apache-2.0
#include "gs_model/mesh/clean_mesh.h"

#include <algorithm>
#include <numeric>

#include "gs_core/geometry/vectors.h"

namespace gs {
namespace {

constexpr std::size_t kLeastTriangles = 50;
constexpr double kLeastShare = 1e-4;  // of all triangles

/// Sets of vertices that are joined one by one.
class Sets {
 public:
  explicit Sets(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0u);
  }
  std::uint32_t root(std::uint32_t v) {
    while (parent_[v] != v) v = parent_[v] = parent_[parent_[v]];
    return v;
  }
  /// The lower root stays, so that the result does not depend on the order.
  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a), b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

}  // namespace

void drop_unused_vertices(TriangleMesh& mesh) {
  constexpr std::uint32_t kUnused = ~0u;
  std::vector<std::uint32_t> number(mesh.vertices.size(), kUnused);
  for (const Triangle& triangle : mesh.triangles)
    for (const std::uint32_t v : triangle) number[v] = 0;
  std::uint32_t count = 0;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == kUnused) continue;
    mesh.vertices[count] = mesh.vertices[v];
    if (!mesh.colors.empty()) mesh.colors[count] = mesh.colors[v];
    number[v] = count++;
  }
  mesh.vertices.resize(count);
  if (!mesh.colors.empty()) mesh.colors.resize(count);
  for (Triangle& triangle : mesh.triangles)
    for (std::uint32_t& v : triangle) v = number[v];
}

std::size_t keep_large_pieces(TriangleMesh& mesh, std::size_t most) {
  Sets sets(mesh.vertices.size());
  for (const Triangle& t : mesh.triangles) sets.join(t[0], t[1]), sets.join(t[1], t[2]);
  std::vector<std::size_t> triangles(mesh.vertices.size(), 0);  // of each root
  for (const Triangle& t : mesh.triangles) ++triangles[sets.root(t[0])];
  std::vector<std::uint32_t> pieces;
  for (std::uint32_t v = 0; v < triangles.size(); ++v)
    if (triangles[v] > 0) pieces.push_back(v);
  std::stable_sort(pieces.begin(), pieces.end(),
                   [&](auto a, auto b) { return triangles[a] > triangles[b]; });
  const double least =
      std::max(double(kLeastTriangles), kLeastShare * double(mesh.triangles.size()));
  std::size_t kept = std::min<std::size_t>(1, pieces.size());
  while (kept < pieces.size() && (most ? kept < most : double(triangles[pieces[kept]]) >= least))
    ++kept;
  for (std::size_t i = kept; i < pieces.size(); ++i) triangles[pieces[i]] = 0;
  std::erase_if(mesh.triangles, [&](const Triangle& t) { return triangles[sets.root(t[0])] == 0; });
  drop_unused_vertices(mesh);
  return kept;
}

void compute_normals(TriangleMesh& mesh) {
  mesh.normals.assign(mesh.vertices.size(), Vec3f(0));
  for (const Triangle& t : mesh.triangles) {
    const Vec3f& a = mesh.vertices[t[0]];
    const Vec3f twice_area = cross(mesh.vertices[t[1]] - a, mesh.vertices[t[2]] - a);
    for (const std::uint32_t v : t) mesh.normals[v] += twice_area;
  }
  for (Vec3f& n : mesh.normals) {
    const float l = length(n);
    n = l > 0 ? n / l : Vec3f(0, 0, 1);
  }
}

}  // namespace gs
