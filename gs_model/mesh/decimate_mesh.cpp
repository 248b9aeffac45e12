// SPDX-License-Identifier: Apache-2.0
#include "gs_model/mesh/decimate_mesh.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <limits>
#include <queue>
#include <tuple>
#include <utility>

#include "gs_core/geometry/vectors.h"
#include "gs_model/mesh/clean_mesh.h"

namespace gs {
namespace {

constexpr double kBorderWeight = 10;    // of a plane through a border, against those of triangles
constexpr double kLengthWeight = 1e-6;  // of an edge's length^4: of equal errors, short edges first
constexpr double kLeastTurnCosine = 0.2;  // between a triangle's normals before and after

/// A sum of squared distances to planes: p^T A p + 2 b . p + c.
struct PlaneErrors {
  Sym3<double> A{};
  Vec3d b{0.0};
  double c = 0;

  void add(const Vec3d& n, double d, double weight) {
    const Vec3d m = weight * n;
    A.xx += m.x * n.x, A.xy += m.x * n.y, A.xz += m.x * n.z;
    A.yy += m.y * n.y, A.yz += m.y * n.z, A.zz += m.z * n.z;
    b += m * d;
    c += weight * d * d;
  }
  void add(const PlaneErrors& other) {
    A.xx += other.A.xx, A.xy += other.A.xy, A.xz += other.A.xz;
    A.yy += other.A.yy, A.yz += other.A.yz, A.zz += other.A.zz;
    b += other.b;
    c += other.c;
  }
  double at(const Vec3d& p) const { return inner(p, multiply(A, p)) + 2 * inner(b, p) + c; }
};

/// An edge that may be contracted, as both of its ends were.
struct Contraction {
  double error;
  std::uint32_t a, b, changes_a, changes_b;
  Vec3f to;
  bool operator>(const Contraction& other) const {
    return std::tie(error, a, b) > std::tie(other.error, other.a, other.b);
  }
};

class MeshDecimation {
 public:
  explicit MeshDecimation(TriangleMesh& mesh)
      : mesh_(mesh), errors_(mesh.vertices.size()), around_(mesh.vertices.size()),
        changes_(mesh.vertices.size(), 0), is_border_(mesh.vertices.size(), 0),
        count_(mesh.triangles.size()) {
    for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t)
      for (const std::uint32_t v : mesh.triangles[t]) around_[v].push_back(t);
    for (const Triangle& t : mesh.triangles) add_planes(t);
    for (const Triangle& t : mesh.triangles)
      for (std::size_t k = 0; k < 3; ++k)
        if (const std::uint32_t a = t[k], b = t[(k + 1) % 3]; a < b || !has_edge(b, a)) offer(a, b);
  }

  void run(std::size_t triangles) {
    while (count_ > triangles && !queue_.empty()) {
      const Contraction next = queue_.top();
      queue_.pop();
      if (next.changes_a == changes_[next.a] && next.changes_b == changes_[next.b]) contract(next);
    }
    std::erase_if(mesh_.triangles, [](const Triangle& t) { return is_gone(t); });
    drop_unused_vertices(mesh_);
  }

 private:
  static bool is_gone(const Triangle& t) { return t[0] == t[1]; }
  static bool has(const Triangle& t, std::uint32_t v) {
    return t[0] == v || t[1] == v || t[2] == v;
  }
  Vec3d point(std::uint32_t v) const { return Vec3d(mesh_.vertices[v]); }
  /// Whether a triangle runs from a to b.
  bool has_edge(std::uint32_t a, std::uint32_t b) const {
    return std::any_of(around_[a].begin(), around_[a].end(), [&](std::uint32_t i) {
      const Triangle& t = mesh_.triangles[i];
      return (t[0] == a && t[1] == b) || (t[1] == a && t[2] == b) || (t[2] == a && t[0] == b);
    });
  }
  void add_planes(const Triangle& t) {
    const Vec3d across = cross(point(t[1]) - point(t[0]), point(t[2]) - point(t[0]));
    const double twice_area = length(across);
    if (!(twice_area > 0)) return;
    const Vec3d n = across / twice_area;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = t[k], b = t[(k + 1) % 3];
      errors_[a].add(n, -inner(n, point(a)), twice_area / 2);
      if (has_edge(b, a)) continue;
      is_border_[a] = is_border_[b] = 1;
      const Vec3d edge = point(b) - point(a);
      const Vec3d out = unit(cross(edge, n));
      for (const std::uint32_t v : {a, b})
        errors_[v].add(out, -inner(out, point(a)), kBorderWeight * inner(edge, edge));
    }
  }
  std::vector<std::uint32_t> neighbors(std::uint32_t v) const {
    std::vector<std::uint32_t> all;
    for (const std::uint32_t i : around_[v])
      for (const std::uint32_t other : mesh_.triangles[i])
        if (other != v) all.push_back(other);
    std::sort(all.begin(), all.end());
    all.erase(std::unique(all.begin(), all.end()), all.end());
    return all;
  }
  void offer(std::uint32_t a, std::uint32_t b) {
    PlaneErrors sum = errors_[a];
    sum.add(errors_[b]);
    const Vec3f &p = mesh_.vertices[a], &q = mesh_.vertices[b];
    Contraction best{std::numeric_limits<double>::infinity(), a, b, changes_[a], changes_[b], p};
    for (const Vec3f& to : {p, q, 0.5f * (p + q)})
      if (const double error = sum.at(Vec3d(to)); error < best.error)
        best.error = error, best.to = to;
    const double square = double(inner(p - q, p - q));
    best.error += kLengthWeight * square * square;
    queue_.push(best);
  }
  /// Whether a triangle keeps its side when one of its corners moves.
  bool keeps_side(const Triangle& t, std::uint32_t corner, const Vec3f& to) const {
    Vec3d before[3], after[3];
    for (std::size_t k = 0; k < 3; ++k) {
      before[k] = point(t[k]);
      after[k] = t[k] == corner ? Vec3d(to) : before[k];
    }
    const Vec3d n = cross(before[1] - before[0], before[2] - before[0]);
    const Vec3d m = cross(after[1] - after[0], after[2] - after[0]);
    return inner(n, m) > kLeastTurnCosine * length(n) * length(m);
  }
  /// Whether the mesh stays what it is, but for the triangles at the edge (Dey et al. 1999).
  bool is_allowed(const Contraction& c) const {
    std::size_t shared = 0;
    for (const std::uint32_t v : {c.a, c.b})
      for (const std::uint32_t i : around_[v]) {
        const Triangle& t = mesh_.triangles[i];
        if (has(t, c.a) && has(t, c.b))
          ++shared;
        else if (!keeps_side(t, v, c.to))
          return false;
      }
    shared /= 2;
    if (shared == 0 || (is_border_[c.a] && is_border_[c.b] && shared != 1)) return false;
    const std::vector<std::uint32_t> of_a = neighbors(c.a), of_b = neighbors(c.b);
    std::vector<std::uint32_t> common;
    std::set_intersection(of_a.begin(), of_a.end(), of_b.begin(), of_b.end(),
                          std::back_inserter(common));
    // Both have the other end and all that is common; a piece keeps four vertices.
    return common.size() == shared && of_a.size() + of_b.size() - common.size() - 2 >= 3;
  }
  void contract(const Contraction& c) {
    if (!is_allowed(c)) return;
    const Vec3f to_a = mesh_.vertices[c.a] - c.to, to_b = mesh_.vertices[c.b] - c.to;
    if (!mesh_.colors.empty() && inner(to_b, to_b) < inner(to_a, to_a))
      mesh_.colors[c.a] = mesh_.colors[c.b];
    mesh_.vertices[c.a] = c.to;
    errors_[c.a].add(errors_[c.b]);
    is_border_[c.a] |= is_border_[c.b];
    const std::vector<std::uint32_t> touched = neighbors(c.b);
    for (const std::uint32_t i : std::exchange(around_[c.b], {})) {
      Triangle& t = mesh_.triangles[i];
      if (has(t, c.a)) {
        t = {0, 0, 0};
        --count_;
        continue;
      }
      std::replace(t.begin(), t.end(), c.b, c.a);
      around_[c.a].push_back(i);
    }
    for (const std::uint32_t v : touched)
      std::erase_if(around_[v], [&](std::uint32_t i) { return is_gone(mesh_.triangles[i]); });
    ++changes_[c.a], ++changes_[c.b];
    for (const std::uint32_t v : neighbors(c.a)) offer(std::min(v, c.a), std::max(v, c.a));
  }

  TriangleMesh& mesh_;
  std::vector<PlaneErrors> errors_;                 // (V)
  std::vector<std::vector<std::uint32_t>> around_;  // (V) triangles of each vertex
  std::vector<std::uint32_t> changes_;              // (V)
  std::vector<char> is_border_;                     // (V)
  std::priority_queue<Contraction, std::vector<Contraction>, std::greater<>> queue_;
  std::size_t count_;
};

}  // namespace

void decimate_mesh(TriangleMesh& mesh, std::size_t triangles) {
  mesh.normals.clear();
  MeshDecimation(mesh).run(triangles);
}

}  // namespace gs
