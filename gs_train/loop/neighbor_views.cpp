// SPDX-License-Identifier: Apache-2.0
#include "gs_train/loop/neighbor_views.h"

#include <algorithm>
#include <cmath>

#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/projection.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kMostCompared = 512;  // that pairs of views are compared by
constexpr float kLeastAxisCosine = 0.866f;
constexpr float kDegree = 0.01745329f;
constexpr float kBestAngle = 5 * kDegree;  // between the rays to a point   Yao et al. 2018, MVSNet
constexpr float kNarrow = 1 * kDegree, kWide = 10 * kDegree;  // below and above it
constexpr float kLeastScore = 0.01f;                          // for each point that the view sees

bool sees(const Camera& camera, const Vec3f& point) {
  const Vec3f p = to_camera(camera, point);
  if (!(p.z > 0)) return false;
  const Vec2f pixel = project_mean(camera, p);
  return pixel.x >= 0 && pixel.y >= 0 && pixel.x < float(camera.width) &&
         pixel.y < float(camera.height);
}

float score_of(const Vec3f& one, const Vec3f& other, const Vec3f& point) {
  const Vec3f a = one - point, b = other - point;
  const float cosine = inner(a, b) / std::sqrt(inner(a, a) * inner(b, b));
  const float angle = std::acos(clamp_to(cosine, -1.0f, 1.0f));
  const float away = (angle - kBestAngle) / (angle < kBestAngle ? kNarrow : kWide);
  return std::exp(-0.5f * away * away);
}

}  // namespace

std::vector<std::vector<std::uint32_t>> neighbor_views(const std::vector<View>& views,
                                                       const std::vector<ScenePoint>& points) {
  std::vector<Vec3f> compared;
  const std::size_t count = std::min(points.size(), kMostCompared);
  for (std::size_t k = 0; k < count; ++k)
    compared.push_back(points[k * points.size() / count].position);
  std::vector<std::vector<std::uint32_t>> seen(views.size());  // by each view
  parallel_for(views.size(), 1, [&](std::size_t i) {
    for (std::uint32_t k = 0; k < compared.size(); ++k)
      if (sees(views[i].camera, compared[k])) seen[i].push_back(k);
  });
  std::vector<std::vector<std::uint32_t>> neighbors(views.size());
  parallel_for(views.size(), 1, [&](std::size_t i) {
    const Camera& camera = views[i].camera;
    const Vec3f eye = camera.position();
    std::vector<std::pair<float, std::uint32_t>> scores;  // the best ones have the lowest
    for (std::uint32_t j = 0; j < views.size(); ++j) {
      const Camera& other = views[j].camera;
      const Vec3f there = other.position();
      const float distance = std::sqrt(inner(there - eye, there - eye));
      if (j == i || !(distance > 0) ||
          inner(camera.cam_from_world_rotation.row2, other.cam_from_world_rotation.row2) <
              kLeastAxisCosine)
        continue;
      if (compared.empty()) {
        scores.push_back({distance, j});
        continue;
      }
      float score = 0;
      std::size_t k = 0;
      for (const std::uint32_t point : seen[i]) {
        while (k < seen[j].size() && seen[j][k] < point) ++k;
        if (k < seen[j].size() && seen[j][k] == point)
          score += score_of(eye, there, compared[point]);
      }
      if (score > kLeastScore * float(seen[i].size())) scores.push_back({-score, j});
    }
    std::sort(scores.begin(), scores.end());
    scores.resize(std::min(scores.size(), kMostNeighbors));
    for (const auto& [score, j] : scores) neighbors[i].push_back(j);
  });
  return neighbors;
}

}  // namespace gs
