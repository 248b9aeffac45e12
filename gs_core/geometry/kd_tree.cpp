// SPDX-License-Identifier: Apache-2.0
#include "gs_core/geometry/kd_tree.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "gs_core/error.h"

namespace gs {

// The k smallest squared distances found so far, ascending.
struct KdTree::Nearest {
  std::uint32_t self;
  Vec3f point;
  int k, found = 0;
  float distance2[kMostNearest];
  std::uint32_t index[kMostNearest];

  float bound() const {
    return found < k ? std::numeric_limits<float>::infinity() : distance2[k - 1];
  }
  void add(float d2, std::uint32_t other) {
    if (d2 >= bound()) return;
    int place = found < k ? found++ : k - 1;
    for (; place > 0 && distance2[place - 1] > d2; --place) {
      distance2[place] = distance2[place - 1];
      index[place] = index[place - 1];
    }
    distance2[place] = d2;
    index[place] = other;
  }
};

KdTree::KdTree(Span<const Vec3f> points) : points_(points), order_(points.size) {
  std::iota(order_.begin(), order_.end(), 0u);
  build(0, order_.size(), 0);
}

void KdTree::build(std::size_t begin, std::size_t end, int axis) {
  if (end - begin < 2) return;
  const std::size_t middle = (begin + end) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](std::uint32_t a, std::uint32_t b) {
                     return points_[a][axis] < points_[b][axis] ||
                            (points_[a][axis] == points_[b][axis] && a < b);
                   });
  build(begin, middle, (axis + 1) % 3);
  build(middle + 1, end, (axis + 1) % 3);
}

void KdTree::search(std::size_t begin, std::size_t end, int axis, Nearest& nearest) const {
  if (begin >= end) return;
  const std::size_t middle = (begin + end) / 2;
  const std::uint32_t here = order_[middle];
  if (here != nearest.self) {
    const Vec3f offset = points_[here] - nearest.point;
    nearest.add(inner(offset, offset), here);
  }
  const float beyond = nearest.point[axis] - points_[here][axis];
  const int next = (axis + 1) % 3;
  const bool left_first = beyond < 0;
  search(left_first ? begin : middle + 1, left_first ? middle : end, next, nearest);
  if (beyond * beyond < nearest.bound())
    search(left_first ? middle + 1 : begin, left_first ? end : middle, next, nearest);
}

float KdTree::mean_squared_distance(std::size_t i, int k) const {
  GS_CHECK(k >= 1 && k <= kMostNearest);
  Nearest nearest{std::uint32_t(i), points_[i], k, 0, {}, {}};
  search(0, order_.size(), 0, nearest);
  float sum = 0;
  for (int n = 0; n < nearest.found; ++n) sum += nearest.distance2[n];
  return nearest.found ? sum / float(nearest.found) : 0;
}

int KdTree::nearest(std::size_t i, int k, std::uint32_t* to) const {
  GS_CHECK(k >= 1 && k <= kMostNearest);
  Nearest nearest{std::uint32_t(i), points_[i], k, 0, {}, {}};
  search(0, order_.size(), 0, nearest);
  std::copy_n(nearest.index, nearest.found, to);
  return nearest.found;
}

}  // namespace gs
