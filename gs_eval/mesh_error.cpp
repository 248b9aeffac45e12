// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/mesh_error.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gs_core/evenly_chosen.h"
#include "gs_core/geometry/triangle_tree.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/random.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kPointsPerTask = 1024;

/// Twice the area of a triangle, along its normal.
Vec3f double_area(const TriangleMesh& mesh, const Triangle& t) {
  const Vec3f& a = mesh.vertices[t[0]];
  return cross(mesh.vertices[t[1]] - a, mesh.vertices[t[2]] - a);
}

/// A point of a surface, and the triangle or the vertex that it is on.
struct SurfacePoint {
  Vec3f at;
  std::uint32_t item;
};

std::vector<SurfacePoint> points_on(const TriangleMesh& mesh, const MeshErrorRule& rule) {
  std::vector<SurfacePoint> points;
  if (mesh.triangles.empty()) {
    for (const std::size_t v : evenly_chosen(mesh.vertices.size(), rule.samples))
      points.push_back({mesh.vertices[v], std::uint32_t(v)});
    return points;
  }
  std::vector<double> area_until(mesh.triangles.size());  // with the triangle
  double sum = 0;
  for (std::size_t t = 0; t < area_until.size(); ++t)
    area_until[t] = sum += double(length(double_area(mesh, mesh.triangles[t])));
  points.resize(rule.samples);
  const Random random{rule.seed, RandomStream::mesh_samples};
  parallel_for(points.size(), kPointsPerTask, [&](std::size_t i) {
    const Vec4f u = random.uniform4(i);
    // One in each of as many equal parts of the area.
    const double area = sum * (double(i) + double(u.x)) / double(points.size());
    const auto found = std::lower_bound(area_until.begin(), area_until.end() - 1, area);
    const auto item = std::uint32_t(found - area_until.begin());
    const Triangle& t = mesh.triangles[item];
    const float root = std::sqrt(u.y);
    points[i] = {(1 - root) * mesh.vertices[t[0]] +
                     root * ((1 - u.z) * mesh.vertices[t[1]] + u.z * mesh.vertices[t[2]]),
                 item};
  });
  return points;
}

bool has_normals(const TriangleMesh& mesh) {
  return !mesh.triangles.empty() || !mesh.normals.empty();
}
/// The normal of a triangle or of a vertex, of length 1; 0 where there is none.
Vec3f normal_of(const TriangleMesh& mesh, std::uint32_t item) {
  const Vec3f n =
      mesh.triangles.empty() ? mesh.normals[item] : double_area(mesh, mesh.triangles[item]);
  const float l = length(n);
  return l > 0 ? n / l : Vec3f(0);
}

/// What the points of one surface are from the other one.
struct Distances {
  std::vector<float> distance, cosine;  // (P) each; no cosines where one has no normals

  double mean() const { return mean_of(distance); }
  double mean_cosine() const { return mean_of(cosine); }
  double share_within(double threshold) const {
    return double(std::count_if(distance.begin(), distance.end(),
                                [&](float d) { return double(d) <= threshold; })) /
           double(distance.size());
  }

 private:
  static double mean_of(const std::vector<float>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) / double(values.size());
  }
};

Distances distances(const TriangleMesh& from, const TriangleMesh& to, const MeshErrorRule& rule) {
  const std::vector<SurfacePoint> points = points_on(from, rule);
  const TriangleTree tree(to);
  Distances result;
  result.distance.resize(points.size());
  const bool compares_normals = has_normals(from) && has_normals(to);
  if (compares_normals) result.cosine.resize(points.size());
  parallel_for(points.size(), kPointsPerTask, [&](std::size_t i) {
    const TriangleTree::Nearest nearest = tree.nearest(points[i].at);
    result.distance[i] = std::sqrt(nearest.distance2);
    if (compares_normals)
      result.cosine[i] =
          std::abs(inner(normal_of(from, points[i].item), normal_of(to, nearest.index)));
  });
  return result;
}

}  // namespace

double area_of(const TriangleMesh& mesh) {
  double sum = 0;
  for (const Triangle& t : mesh.triangles) sum += double(length(double_area(mesh, t))) / 2;
  return sum;
}

MeshError mesh_error(const TriangleMesh& mesh, const TriangleMesh& truth,
                     const MeshErrorRule& rule) {
  const Distances of_mesh = distances(mesh, truth, rule), of_truth = distances(truth, mesh, rule);
  MeshError error{of_mesh.mean(), of_truth.mean(), {}, {}};
  if (!of_mesh.cosine.empty())
    error.normal_consistency = (of_mesh.mean_cosine() + of_truth.mean_cosine()) / 2;
  for (const double threshold : rule.thresholds)
    error.within.push_back(
        {threshold, of_mesh.share_within(threshold), of_truth.share_within(threshold)});
  return error;
}

}  // namespace gs
