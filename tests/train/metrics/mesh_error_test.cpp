// SPDX-License-Identifier: Apache-2.0
// Distances between surfaces whose distances are known.
#include "gs_eval/mesh_error.h"

#include <cmath>

#include "gs_core/geometry/triangle_tree.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/threads/parallel.h"
#include "tests/support/scenes.h"
#include "tests/support/test.h"

namespace gs {
namespace {

/// A sphere of so many rings.
TriangleMesh sphere(float radius, std::uint32_t rings = 80) {
  TriangleMesh mesh;
  const std::uint32_t around = 2 * rings;
  for (std::uint32_t r = 0; r <= rings; ++r)
    for (std::uint32_t i = 0; i < around; ++i) {
      const float polar = 3.14159265f * float(r) / float(rings);
      const float turn = 6.2831853f * float(i) / float(around);
      mesh.vertices.push_back(radius * Vec3f(std::sin(polar) * std::cos(turn),
                                             std::sin(polar) * std::sin(turn), std::cos(polar)));
    }
  for (std::uint32_t r = 0; r < rings; ++r)
    for (std::uint32_t i = 0; i < around; ++i) {
      const std::uint32_t a = r * around + i, b = r * around + (i + 1) % around;
      mesh.triangles.push_back({a, a + around, b + around});
      mesh.triangles.push_back({a, b + around, b});
    }
  return mesh;
}

/// A square from 0 to `side` in x and y.
TriangleMesh square(float side, float z) {
  TriangleMesh mesh;
  mesh.vertices = {Vec3f(0, 0, z), Vec3f(side, 0, z), Vec3f(side, side, z), Vec3f(0, side, z)};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

MeshErrorRule rule_of(std::vector<double> thresholds) { return {20000, 7, std::move(thresholds)}; }

TEST(MeshError, OfASphereAgainstALargerOneIsTheDifferenceOfTheirRadii) {
  const MeshError error = mesh_error(sphere(1.1f), sphere(1), rule_of({0.09, 0.11}));
  EXPECT_NEAR(error.accuracy, 0.1, 1e-3);  // both are polyhedra
  EXPECT_NEAR(error.completeness, 0.1, 1e-3);
  EXPECT_NEAR(error.chamfer(), 0.1, 1e-3);
  EXPECT_GT(error.normal_consistency.value(), 0.999);
  EXPECT_EQ(error.within[0].f1(), 0);
  EXPECT_EQ(error.within[1].precision, 1);
  EXPECT_EQ(error.within[1].recall, 1);
  EXPECT_EQ(error.within[1].f1(), 1);
}

TEST(MeshError, OfAShiftedPlaneIsTheShift) {
  const MeshError error = mesh_error(square(1, 0.25f), square(1, 0), rule_of({0.25}));
  EXPECT_FLOAT_EQ(float(error.accuracy), 0.25f);
  EXPECT_FLOAT_EQ(float(error.completeness), 0.25f);
  EXPECT_FLOAT_EQ(float(error.normal_consistency.value()), 1);
  EXPECT_EQ(error.within[0].f1(), 1);
}

// A mesh that covers a quarter of the truth is right, and not complete.
TEST(MeshError, WhatIsMissingCountsInCompletenessAndRecallAlone) {
  const MeshError error = mesh_error(square(1, 0), square(2, 0), rule_of({1e-6}));
  EXPECT_NEAR(error.accuracy, 0, 1e-7);
  EXPECT_EQ(error.within[0].precision, 1);
  const double tolerance = 0.013;  // four standard deviations of 20,000 points
  EXPECT_NEAR(error.within[0].recall, 0.25, tolerance);
  EXPECT_NEAR(error.within[0].f1(), 0.4, 1.3 * tolerance);
  // The mean distance of the other three quarters from the unit square.
  const double corner = (std::sqrt(2.0) + std::asinh(1.0)) / 3;
  EXPECT_NEAR(error.completeness, (2 * 0.5 + corner) / 4, tolerance);
}

TEST(MeshError, PointsHaveNoNormalsUnlessTheirFileHas) {
  TriangleMesh points = sphere(1);
  points.triangles.clear();
  const TriangleMesh truth = sphere(1);
  EXPECT_FALSE(mesh_error(points, truth, rule_of({})).normal_consistency);
  for (const Vec3f& vertex : points.vertices) points.normals.push_back(unit(vertex));
  const MeshError error = mesh_error(points, truth, rule_of({0.05}));
  EXPECT_GT(error.normal_consistency.value(), 0.99);
  EXPECT_NEAR(error.accuracy, 0, 1e-6);
  EXPECT_EQ(error.within[0].f1(), 1);
}

TEST(MeshError, DependsOnTheSeedAndNotOnThreads) {
  const TriangleMesh a = sphere(1, 8), b = sphere(1.1f, 9);
  MeshErrorRule rule = rule_of({0.1});
  set_thread_count(1);
  const MeshError one = mesh_error(a, b, rule);
  set_thread_count(4);
  const MeshError four = mesh_error(a, b, rule);
  set_thread_count(0);
  EXPECT_EQ(one.accuracy, four.accuracy);
  EXPECT_EQ(one.completeness, four.completeness);
  EXPECT_EQ(one.within[0].f1(), four.within[0].f1());
  ++rule.seed;
  EXPECT_NE(one.accuracy, mesh_error(a, b, rule).accuracy);
}

// Triangles of any shape, also lines and points, against all of them one by one.
TEST(TriangleTree, FindsTheNearestOfAllTriangles) {
  Draws draws(5);
  const auto point = [&] {
    return Vec3f(draws.uniform(-1, 1), draws.uniform(-1, 1), draws.uniform(-1, 1));
  };
  TriangleMesh mesh;
  for (std::uint32_t t = 0; t < 301; ++t) {
    const Vec3f at = point();
    for (int k = 0; k < 3; ++k) mesh.vertices.push_back(at + 0.2f * point());
    if (t % 10 == 0) mesh.vertices.back() = mesh.vertices[3 * t];
    mesh.triangles.push_back({3 * t, 3 * t + 1, 3 * t + 2});
  }
  const TriangleTree tree(mesh);
  for (int i = 0; i < 200; ++i) {
    const Vec3f from = 1.5f * point();
    float least = 1e9f;
    for (std::uint32_t t = 0; t < 301; ++t) {
      TriangleMesh one = mesh;
      one.triangles = {mesh.triangles[t]};
      least = std::min(least, TriangleTree(one).nearest(from).distance2);
      // No point of the triangle is nearer than its distance.
      const float u = draws.uniform(0, 1), v = draws.uniform(0, 1 - u);
      const Vec3f to = (1 - u - v) * mesh.vertices[3 * t] + u * mesh.vertices[3 * t + 1] +
                       v * mesh.vertices[3 * t + 2] - from;
      EXPECT_GE(inner(to, to), TriangleTree(one).nearest(from).distance2 * (1 - 1e-4f));
    }
    EXPECT_EQ(tree.nearest(from).distance2, least);
  }
}

}  // namespace
}  // namespace gs
