// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/align_start.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "data_loaders/photos/photo_names.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/math/render/rotation.h"

namespace gs {
namespace {

constexpr double kSamePlace = 0.01;      // of the spread of the cameras
constexpr double kSameDirection = 0.01;  // of a quaternion: about a degree
constexpr double kOnePlace = 1e-6;       // spread, of the positions' sizes

/// Where a camera stands and how it looks.
struct Pose {
  Vec3d center;
  Quat<double> world_from_cam;
};
struct PosePair {
  Pose model, scene;
};

Pose pose_of(const Camera& camera, const Vec3d& offset) {
  const PinholeCamera<double> precise = camera_as<double>(camera);
  const Quat<double> q = quaternion_of(precise.cam_from_world_rotation);
  return {precise.position() + offset, {q.w, -q.x, -q.y, -q.z}};
}

std::vector<PosePair> pairs_of(const std::vector<NamedCamera>& cameras, const Vec3d& offset,
                               const Scene& scene) {
  std::map<std::string, const Camera*> by_name;
  for (const NamedCamera& named : cameras) by_name[named.name] = &named.camera;
  std::vector<PosePair> pairs;
  for (const auto* views : {&scene.train_views, &scene.test_views})
    for (const View& view : *views)
      if (const auto found = by_name.find(without_extension(view.name)); found != by_name.end())
        pairs.push_back({pose_of(*found->second, offset), pose_of(view.camera, Vec3d(0.0))});
  return pairs;
}

/// The mean of centers, and the root of their mean squared distance from it.
struct Spread {
  Vec3d mean{0.0, 0.0, 0.0};
  double size = 0;
};
template <class CenterOf>
Spread spread_of(const std::vector<PosePair>& pairs, const CenterOf& center_of) {
  Spread spread;
  for (const PosePair& pair : pairs) spread.mean += center_of(pair) / double(pairs.size());
  double sum = 0;
  for (const PosePair& pair : pairs) {
    const Vec3d d = center_of(pair) - spread.mean;
    sum += inner(d, d);
  }
  spread.size = std::sqrt(sum / double(pairs.size()));
  return spread;
}

/// The turn that takes the directions of the model's cameras to those of the scene's, in the mean.
Quat<double> mean_turn(const std::vector<PosePair>& pairs) {
  Quat<double> sum{0, 0, 0, 0};
  for (const PosePair& pair : pairs) {
    const Quat<double>& m = pair.model.world_from_cam;
    Quat<double> q = product(pair.scene.world_from_cam, Quat<double>{m.w, -m.x, -m.y, -m.z});
    const double side = q.w * sum.w + q.x * sum.x + q.y * sum.y + q.z * sum.z;
    const double sign = side < 0 ? -1 : 1;
    sum = {sum.w + sign * q.w, sum.x + sign * q.x, sum.y + sign * q.y, sum.z + sign * q.z};
  }
  const double norm = std::sqrt(squared_norm(sum)) * (sum.w < 0 ? -1 : 1);
  return {sum.w / norm, sum.x / norm, sum.y / norm, sum.z / norm};
}

template <class DistanceOf>
double median(const std::vector<PosePair>& pairs, const DistanceOf& distance_of) {
  std::vector<double> distances;
  for (const PosePair& pair : pairs) distances.push_back(distance_of(pair));
  const auto middle = distances.begin() + std::ptrdiff_t(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return *middle;
}

}  // namespace

std::optional<SharedCameras> shared_cameras(const std::vector<NamedCamera>& cameras,
                                            const Vec3d& offset, const Scene& scene) {
  const std::vector<PosePair> pairs = pairs_of(cameras, offset, scene);
  if (pairs.size() < 3) return std::nullopt;
  const Spread of_model = spread_of(pairs, [](const PosePair& p) { return p.model.center; });
  const Spread of_scene = spread_of(pairs, [](const PosePair& p) { return p.scene.center; });
  if (!(of_model.size > kOnePlace * (1 + length(of_model.mean))) ||
      !(of_scene.size > kOnePlace * (1 + length(of_scene.mean))))
    return std::nullopt;

  SharedCameras shared;
  shared.count = pairs.size();
  const Quat<double> turn = mean_turn(pairs);
  const double moved =
      median(pairs, [](const PosePair& p) { return length(p.scene.center - p.model.center); });
  shared.coincide =
      moved < kSamePlace * of_scene.size && 1 - turn.w < kSameDirection * kSameDirection;

  const Mat3<double> R = rotation_matrix(turn);
  ModelTransform& transform = shared.transform;
  transform.turn = turn;
  transform.scale = of_scene.size / of_model.size;
  transform.center = of_model.mean - multiply_transposed(R, of_scene.mean) / transform.scale;
  shared.error = median(pairs,
                        [&](const PosePair& p) {
                          const Vec3d there = multiply(R, p.model.center - transform.center);
                          return length(transform.scale * there - p.scene.center);
                        }) /
                 of_scene.size;
  return shared;
}

}  // namespace gs
