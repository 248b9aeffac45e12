// SPDX-License-Identifier: Apache-2.0
#include "gs_model/edit/select.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/projection.h"
#include "gs_core/math/render/rotation.h"
#include "gs_model/edit/merge_gaussians.h"

namespace gs {
namespace {

constexpr double kReach = 3;  // standard deviations

// (N) f(i), computed on all cores.
template <class F>
std::vector<float> values_of(std::size_t count, F&& f) {
  std::vector<float> values(count);
  parallel_for(count, 4096, [&](std::size_t i) { values[i] = float(f(i)); });
  return values;
}

}  // namespace

std::vector<std::uint32_t> rows_marked(const Marks& marks, bool value) {
  std::vector<std::uint32_t> rows;
  for (std::uint32_t i = 0; i < marks.size(); ++i)
    if ((marks[i] != 0) == value) rows.push_back(i);
  return rows;
}

std::vector<std::uint32_t> rows_with_largest(const std::vector<float>& scores, std::size_t count) {
  const auto score = [&](std::uint32_t i) {
    return std::isnan(scores[i]) ? -std::numeric_limits<float>::infinity() : scores[i];
  };
  std::vector<std::uint32_t> rows(scores.size());
  std::iota(rows.begin(), rows.end(), 0u);
  std::stable_sort(rows.begin(), rows.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return score(a) > score(b); });
  rows.resize(std::min(count, rows.size()));
  std::sort(rows.begin(), rows.end());
  return rows;
}

bool Box::holds(const Vec3d& point) const {
  for (int axis = 0; axis < 3; ++axis)
    if (!(point[axis] >= low[axis] && point[axis] <= high[axis])) return false;
  return true;
}

Box box_between(const Vec3d& a, const Vec3d& b) {
  Box box{a, a};
  for (int axis = 0; axis < 3; ++axis) {
    box.low[axis] = std::min(a[axis], b[axis]);
    box.high[axis] = std::max(a[axis], b[axis]);
  }
  return box;
}

Box box_of_means(const Gaussians& gaussians) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Box box{Vec3d(kInfinity), Vec3d(-kInfinity)};
  for (const Vec3f& mean : gaussians.mean) {
    if (!is_finite(mean)) continue;
    for (int axis = 0; axis < 3; ++axis) {
      box.low[axis] = std::min(box.low[axis], double(mean[axis]));
      box.high[axis] = std::max(box.high[axis], double(mean[axis]));
    }
  }
  return box.low.x <= box.high.x ? box : Box{Vec3d(0.0), Vec3d(0.0)};
}

std::optional<Vec2f> pixel_in_sight(const Camera& camera, const Vec3f& point) {
  const Vec3f p = to_camera(camera, point);
  return is_in_sight(camera, p) ? std::optional(pixel_of(camera, p)) : std::nullopt;
}

bool is_in_picture(const Camera& camera, const Vec3f& point) {
  const std::optional<Vec2f> at = pixel_in_sight(camera, point);
  return at && at->x >= 0 && at->y >= 0 && at->x <= float(camera.width) &&
         at->y <= float(camera.height);
}

std::vector<Vec3f> reaches_of(const Gaussians& gaussians) {
  std::vector<Vec3f> reaches(gaussians.count());
  parallel_for(reaches.size(), 4096, [&](std::size_t i) {
    const Quatf& q = gaussians.rotation[i];
    const Sym3<double> S = covariance(rotation_matrix(Quat<double>{q.w, q.x, q.y, q.z}),
                                      variance(Vec3d(gaussians.log_scale[i])));
    reaches[i] = Vec3f(kReach * Vec3d(std::sqrt(S.xx), std::sqrt(S.yy), std::sqrt(S.zz)));
  });
  return reaches;
}

std::vector<float> sizes_of(const Gaussians& gaussians) {
  return values_of(gaussians.count(), [&](std::size_t i) {
    const Vec3f& s = gaussians.log_scale[i];
    return std::exp(std::max({s.x, s.y, s.z}));
  });
}

std::vector<float> coverages_of(const Gaussians& gaussians) {
  return values_of(gaussians.count(),
                   [&](std::size_t i) { return merge_shape_of(gaussians, i).mass(); });
}

std::vector<float> distances_to_nearest(const Gaussians& gaussians,
                                        const std::vector<Vec3f>& positions) {
  return values_of(gaussians.count(), [&](std::size_t i) {
    float nearest = std::numeric_limits<float>::infinity();
    for (const Vec3f& position : positions) {
      const Vec3f d = gaussians.mean[i] - position;
      nearest = std::min(nearest, inner(d, d));
    }
    return std::sqrt(nearest);
  });
}

}  // namespace gs
