// SPDX-License-Identifier: Apache-2.0
// Points in space, for gemsplat/_arrays.py, which has checked its arrays.
#include "apps/python/arrays.h"
#include "apps/python/devices.h"
#include "apps/python/module.h"
#include "gs_core/geometry/kd_tree.h"
#include "gs_core/threads/parallel.h"

namespace gs::python {
namespace {

constexpr std::size_t kPointGrain = 1024;  // points that a thread takes at once

FloatArray nearest_distances(const FloatArray& points, int k) {
  const auto count = std::size_t(points.shape(0));
  FloatArray distances(points.shape(0));
  const auto* const places = reinterpret_cast<const Vec3f*>(points.data());
  float* const to = distances.mutable_data();
  const py::gil_scoped_release release;
  const Work work;
  const KdTree tree({places, count});
  parallel_for(count, kPointGrain,
               [&](std::size_t i) { to[i] = tree.mean_squared_distance(i, k); });
  return distances;
}

}  // namespace

void bind_points(py::module_& module) {
  module.attr("MOST_NEAREST") = int(KdTree::kMostNearest);
  module.def("nearest_distances", nearest_distances);
}

}  // namespace gs::python
