// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geometry/triangle_tree.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <numeric>

#include "gs_core/error.h"

namespace gs {
namespace {

constexpr std::size_t kLeafItems = 4;

/// The squared distance of the origin from a segment.
float distance2_of_segment(const Vec3f& a, const Vec3f& b) {
  const Vec3f along = b - a;
  const float square = inner(along, along);
  const float t = square > 0 ? clamp_to(-inner(a, along) / square, 0.0f, 1.0f) : 0.0f;
  const Vec3f nearest = a + t * along;
  return inner(nearest, nearest);
}

/// The squared distance of the origin from a triangle, which may be a line or a point.
float distance2_of_triangle(const std::array<Vec3f, 3>& at) {
  const auto& [a, b, c] = at;
  const Vec3f n = cross(b - a, c - a);
  const float square = inner(n, n);
  const auto is_left = [&](const Vec3f& p, const Vec3f& q) {
    return inner(cross(p - q, p), n) >= 0;  // of the edge from p to q
  };
  if (square > 0 && is_left(a, b) && is_left(b, c) && is_left(c, a)) {
    const float height = inner(a, n);
    return height * height / square;
  }
  return std::min(
      {distance2_of_segment(a, b), distance2_of_segment(b, c), distance2_of_segment(c, a)});
}

}  // namespace

TriangleTree::TriangleTree(const TriangleMesh& mesh)
    : mesh_(mesh), order_(mesh.triangles.empty() ? mesh.vertices.size() : mesh.triangles.size()) {
  GS_CHECK(!order_.empty());
  std::iota(order_.begin(), order_.end(), 0u);
  boxes_.resize(2 * std::bit_ceil((order_.size() + kLeafItems - 1) / kLeafItems) - 1);
  build(0, 0, order_.size());
}

std::array<Vec3f, 3> TriangleTree::corners(std::uint32_t item) const {
  if (mesh_.triangles.empty())
    return {mesh_.vertices[item], mesh_.vertices[item], mesh_.vertices[item]};
  const Triangle& t = mesh_.triangles[item];
  return {mesh_.vertices[t[0]], mesh_.vertices[t[1]], mesh_.vertices[t[2]]};
}

void TriangleTree::build(std::size_t node, std::size_t begin, std::size_t end) {
  constexpr float kMost = std::numeric_limits<float>::max();
  Box box{Vec3f(kMost), Vec3f(-kMost)};
  for (std::size_t i = begin; i < end; ++i)
    for (const Vec3f& corner : corners(order_[i]))
      for (int axis = 0; axis < 3; ++axis) {
        box.low[axis] = std::min(box.low[axis], corner[axis]);
        box.high[axis] = std::max(box.high[axis], corner[axis]);
      }
  boxes_[node] = box;
  if (end - begin <= kLeafItems) return;
  const Vec3f size = box.high - box.low;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const auto place = [&](std::uint32_t item) {
    const auto [a, b, c] = corners(item);
    return a[axis] + b[axis] + c[axis];
  };
  const std::size_t middle = (begin + end) / 2;
  const auto first = order_.begin();
  std::nth_element(first + std::ptrdiff_t(begin), first + std::ptrdiff_t(middle),
                   first + std::ptrdiff_t(end),
                   [&](std::uint32_t a, std::uint32_t b) { return place(a) < place(b); });
  build(2 * node + 1, begin, middle);
  build(2 * node + 2, middle, end);
}

void TriangleTree::search(std::size_t node, std::size_t begin, std::size_t end, const Vec3f& point,
                          Nearest& best) const {
  if (end - begin <= kLeafItems) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto [a, b, c] = corners(order_[i]);
      const float d2 = distance2_of_triangle({a - point, b - point, c - point});
      if (d2 < best.distance2) best = {d2, order_[i]};
    }
    return;
  }
  const auto distance2 = [&](std::size_t child) {
    float sum = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const float beyond = std::max(
          {boxes_[child].low[axis] - point[axis], point[axis] - boxes_[child].high[axis], 0.0f});
      sum += beyond * beyond;
    }
    return sum;
  };
  const std::size_t middle = (begin + end) / 2;
  const float of_first = distance2(2 * node + 1), of_second = distance2(2 * node + 2);
  const auto visit_first = [&] {
    if (of_first < best.distance2) search(2 * node + 1, begin, middle, point, best);
  };
  if (of_first <= of_second) visit_first();
  if (of_second < best.distance2) search(2 * node + 2, middle, end, point, best);
  if (of_first > of_second) visit_first();
}

TriangleTree::Nearest TriangleTree::nearest(const Vec3f& point) const {
  Nearest best{std::numeric_limits<float>::infinity(), 0};
  search(0, 0, order_.size(), point, best);
  return best;
}

}  // namespace gs
