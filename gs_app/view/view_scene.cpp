// SPDX-License-Identifier: Apache-2.0
#include "gs_app/view/view_scene.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kPointsLookedAt = 100'000;
constexpr double kOrdinaryShare = 0.9;
// How much the middle of the points weighs against the cameras' lines of sight: decides along lines that are all parallel,
// and moves the crossing of others by a few percent at most.
constexpr double kMiddleWeight = 0.02;

Mat3<double> rotation_of(const Camera& camera) {
  const Mat3<float>& R = camera.cam_from_world_rotation;
  return {Vec3d(R.row0), Vec3d(R.row1), Vec3d(R.row2)};
}

Vec3d position_of(const Camera& camera) {
  return -multiply_transposed(rotation_of(camera), Vec3d(camera.cam_from_world_translation));
}

double length(const Vec3d& v) { return std::sqrt(inner(v, v)); }

// The value that the share of all does not exceed; `values` is not empty.
double quantile(std::vector<double>& values, double share) {
  const auto place = values.begin() + std::ptrdiff_t(share * double(values.size() - 1));
  std::nth_element(values.begin(), place, values.end());
  return *place;
}

std::vector<Vec3d> some_of(Span<const Vec3f> points) {
  std::vector<Vec3d> some;
  const std::size_t step = points.size / kPointsLookedAt + 1;
  for (std::size_t i = 0; i < points.size; i += step)
    if (is_finite(points[i])) some.push_back(Vec3d(points[i]));
  return some;
}

// Axis by axis, so that outliers do not move it. 0 where there are no points.
Vec3d middle_of(const std::vector<Vec3d>& points) {
  Vec3d middle(0.0);
  std::vector<double> values(points.size());
  for (int axis = 0; axis < 3 && !points.empty(); ++axis) {
    std::transform(points.begin(), points.end(), values.begin(),
                   [&](const Vec3d& point) { return point[axis]; });
    middle[axis] = quantile(values, 0.5);
  }
  return middle;
}

// The distance from `center` that most keep; 0 where there are no points.
double reach(const Vec3d& center, const std::vector<Vec3d>& points) {
  std::vector<double> distances;
  for (const Vec3d& point : points) distances.push_back(length(point - center));
  return distances.empty() ? 0 : quantile(distances, kOrdinaryShare);
}

// x with S x = b; S is positive definite (Cramer's rule).
Vec3d solution(const Sym3<double>& S, const Vec3d& b) {
  const Sym3<double> adjugate{S.yy * S.zz - S.yz * S.yz, S.xz * S.yz - S.xy * S.zz,
                              S.xy * S.yz - S.xz * S.yy, S.xx * S.zz - S.xz * S.xz,
                              S.xy * S.xz - S.xx * S.yz, S.xx * S.yy - S.xy * S.xy};
  const double determinant = S.xx * adjugate.xx + S.xy * adjugate.xy + S.xz * adjugate.xz;
  return multiply(adjugate, b) / determinant;
}

// The point that is nearest to all lines of sight, and to `middle` a little: the least sum of squared distances.
Vec3d looked_at(const std::vector<ViewedCamera>& cameras, const Vec3d& middle) {
  const double w = kMiddleWeight * double(cameras.size());
  Sym3<double> S{w, 0, 0, w, 0, w};
  Vec3d b = w * middle;
  for (const ViewedCamera& viewed : cameras) {
    const Vec3d d = rotation_of(viewed.camera).row2;  // forward
    const Sym3<double> P{1 - d.x * d.x, -d.x * d.y, -d.x * d.z,
                         1 - d.y * d.y, -d.y * d.z, 1 - d.z * d.z};  // away from the line
    S = {S.xx + P.xx, S.xy + P.xy, S.xz + P.xz, S.yy + P.yy, S.yz + P.yz, S.zz + P.zz};
    b += multiply(P, position_of(viewed.camera));
  }
  return solution(S, b);
}

Vec3d mean_up(const std::vector<ViewedCamera>& cameras) {
  Vec3d up(0.0);
  for (const ViewedCamera& viewed : cameras) up -= rotation_of(viewed.camera).row1;
  const double size = length(up);
  return size > 1e-3 * double(cameras.size()) ? up / size : Framing().up;
}

Json list_of(const Vec3d& v) { return {v.x, v.y, v.z}; }

Json camera_json(const ViewedCamera& viewed, std::size_t index) {
  const Camera& camera = viewed.camera;
  const Mat3<float>& R = camera.cam_from_world_rotation;
  const Vec3d p = position_of(camera);
  Json json = {{"name", viewed.name},     {"split", viewed.split}, {"width", camera.width},
               {"height", camera.height}, {"fx", camera.fx},       {"fy", camera.fy},
               {"cx", camera.cx},         {"cy", camera.cy}};
  json["world_from_camera"] = {R.row0.x, R.row1.x, R.row2.x, p.x,  //
                               R.row0.y, R.row1.y, R.row2.y, p.y,  //
                               R.row0.z, R.row1.z, R.row2.z, p.z,  //
                               0,        0,        0,        1};
  json["photo"] = viewed.view ? Json(fmt::format("photo/{}", index)) : Json();
  return json;
}

}  // namespace

Framing framing_of(const std::vector<ViewedCamera>& cameras, Span<const Vec3f> points) {
  const std::vector<Vec3d> some = some_of(points);
  const Vec3d middle = middle_of(some);
  Framing framing;
  framing.center = middle;
  framing.radius = reach(middle, some);
  if (!cameras.empty()) {
    framing.up = mean_up(cameras);
    framing.center = looked_at(cameras, middle);
    std::vector<Vec3d> positions;
    for (const ViewedCamera& viewed : cameras) positions.push_back(position_of(viewed.camera));
    const double distance = reach(framing.center, positions);
    if (distance > 0) framing.radius = distance;
  }
  if (!(framing.radius > 0) || !std::isfinite(framing.radius)) framing.radius = 1;
  return framing;
}

Json scene_json(const ViewScene& scene) {
  Json json = {{"title", scene.title},
               {"background", {scene.background.x, scene.background.y, scene.background.z}},
               {"up", list_of(scene.framing.up)},
               {"center", list_of(scene.framing.center)},
               {"radius", scene.framing.radius},
               {"near", scene.near_plane},
               {"far", scene.far_plane},
               {"notes", scene.notes}};
  Json cameras = Json::array();
  for (std::size_t i = 0; i < scene.cameras.size(); ++i)
    cameras.push_back(camera_json(scene.cameras[i], i));
  json["cameras"] = std::move(cameras);
  return json;
}

void take_settings(ViewScene& scene, const RenderSettings& settings) {
  scene.background = settings.background;
  scene.near_plane = settings.near_plane;
  scene.far_plane = settings.far_plane;
}

std::vector<ViewedCamera> viewed_cameras(const Scene& scene) {
  std::vector<ViewedCamera> cameras;
  for (const View& view : scene.test_views)
    cameras.push_back({view.name, "test", view.camera, &view});
  for (const View& view : scene.train_views)
    cameras.push_back({view.name, "train", view.camera, &view});
  return cameras;
}

}  // namespace gs
