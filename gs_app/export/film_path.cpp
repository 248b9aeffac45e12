// SPDX-License-Identifier: Apache-2.0
#include "gs_app/export/film_path.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <filesystem>
#include <numbers>
#include <numeric>

#include "data_loaders/photos/photo_names.h"
#include "gs_app/pictures/pictures.h"
#include "gs_core/config/text/nearest_word.h"
#include "gs_core/error.h"
#include "gs_core/system/log.h"
#include "gs_core/system/text/json.h"
#include "gs_render/paths/camera_path.h"

namespace gs {
namespace {

constexpr double kNarrowestSwing = std::numbers::pi / 18;  // radians: where all cameras are near

/// The camera of that name, with or without extension, or else of that number.
std::size_t find_camera(const std::string& word, const std::vector<NamedCamera>& cameras) {
  for (std::size_t i = 0; i < cameras.size(); ++i)
    if (cameras[i].name == word) return i;
  for (std::size_t i = 0; i < cameras.size(); ++i)
    if (without_extension(cameras[i].name) == without_extension(word)) return i;
  for (std::size_t i = 0; i < cameras.size(); ++i)
    if (std::to_string(i) == word) return i;
  std::vector<std::string> names;
  for (const NamedCamera& named : cameras) names.push_back(named.name);
  const std::string near = nearest_word(word, names);
  throw UsageError(fmt::format(
      "--through {}: there is no camera of that name, and none of that number from 0 "
      "to {}{}",
      word, cameras.size() - 1,
      near.empty() ? "; the first is called " + names.front() : "; did you mean " + near + "?"));
}

std::vector<CameraPose> poses_of(const std::vector<NamedCamera>& cameras) {
  std::vector<CameraPose> poses;
  for (const NamedCamera& named : cameras) poses.push_back(pose_of(named.camera));
  return poses;
}

/// Numbers of the cameras that the path passes, in its order.
std::vector<std::size_t> keys_of(const PathRequest& request,
                                 const std::vector<NamedCamera>& cameras) {
  std::vector<std::size_t> keys;
  if (request.kind == "flythrough") {
    const std::vector<CameraPose> poses = poses_of(cameras);
    const auto chosen = representative_poses(poses, std::size_t(request.keys));
    std::vector<CameraPose> stops;
    for (const std::size_t i : chosen) stops.push_back(poses[i]);
    for (const std::size_t i : short_tour(stops)) keys.push_back(chosen[i]);
  } else if (request.kind == kKeyFrames) {
    keys.resize(cameras.size());
    std::iota(keys.begin(), keys.end(), std::size_t(0));
  } else if (request.through.empty()) {
    keys = evenly_chosen(cameras.size(), std::size_t(request.keys));
  } else {
    for (const std::string& word : request.through) keys.push_back(find_camera(word, cameras));
  }
  return keys;
}

Json json_of(const Vec3d& v) { return {v.x + 0.0, v.y + 0.0, v.z + 0.0}; }  // no -0

struct PosedPath {
  std::vector<CameraPose> poses;
  std::size_t lens = 0;  // the number of the camera that has it
  Json description;
};

PosedPath through_cameras(const PathRequest& request, const std::vector<NamedCamera>& cameras) {
  const std::vector<std::size_t> keys = keys_of(request, cameras);
  const bool is_closed = request.kind == "flythrough" || request.is_loop;
  Json names = Json::array();
  std::vector<CameraPose> poses;
  for (const std::size_t i : keys) {
    poses.push_back(pose_of(cameras[i].camera));
    names.push_back(cameras[i].name);
  }
  const CameraSpline spline(poses, is_closed);
  if (spline.end() == 0)
    throw UsageError(
        fmt::format("--path {} needs two cameras with different poses, but all {} have the same "
                    "pose; name others with --through, or use --path orbit",
                    request.kind, keys.size()));
  return {
      poses_along(spline, request.frames, request.pace == "even" ? Pace::even : Pace::by_keys),
      keys.front(),
      {{"kind", request.kind}, {"through", names}, {"closed", is_closed}, {"pace", request.pace}}};
}

double degrees_of(double radians) { return radians * 180 / std::numbers::pi; }

// What no photo shows is fog. Where photos were taken from one side, the film stays there.
void swing_over_photos(Orbit& circle, const std::vector<CameraPose>& poses) {
  const CameraArc arc = arc_of_cameras(circle.frame, poses);
  if (arc.width >= 2 * std::numbers::pi) return;
  circle.swing = std::max(arc.width, kNarrowestSwing);
  circle.start = arc.middle;
  log_info(
      "the photos were taken from {:.0f} degrees of the circle around the scene, and the film goes "
      "to and fro over these; --turns 1 goes all around",
      degrees_of(arc.width));
}

PosedPath round_the_scene(const PathRequest& request, const std::vector<NamedCamera>& cameras,
                          Span<const Vec3f> points, const Vec3d& world_offset) {
  std::vector<Camera> all;
  for (const NamedCamera& named : cameras) all.push_back(named.camera);
  Orbit circle;
  circle.frame = request.center ? scene_frame_about(*request.center - world_offset, all)
                                : scene_frame(all, points);
  if (!circle.frame.up_is_known)
    log_warning(
        "the cameras are held in all directions or lie on their side, so the way up is a guess: if "
        "the film is tilted, take --path flythrough, or turn the model with `gemsplat edit --up`");
  circle.turns = request.turns.value_or(1);
  circle.start = Vec3d(cameras.front().camera.position());
  if (!request.turns) swing_over_photos(circle, poses_of(cameras));
  if (request.radius) circle.frame.radius = *request.radius;
  if (request.elevation) circle.frame.elevation = *request.elevation;
  const SceneFrame& frame = circle.frame;
  const bool swings = circle.swing != 0;
  return {orbit(circle, request.frames),
          0,
          {{"kind", request.kind},
           {swings ? "swing" : "turns", swings ? degrees_of(circle.swing) : circle.turns},
           {"center", json_of(frame.center + world_offset)},
           {"up", json_of(frame.up)},
           {"radius", frame.radius},
           {"elevation", frame.elevation}}};
}

}  // namespace

FilmPath film_path(const PathRequest& request, const std::vector<NamedCamera>& cameras,
                   Span<const Vec3f> points, const Vec3d& world_offset) {
  PosedPath path = request.kind == "orbit" ? round_the_scene(request, cameras, points, world_offset)
                                           : through_cameras(request, cameras);
  FilmPath film{{}, std::move(path.description)};
  for (std::size_t i = 0; i < path.poses.size(); ++i)
    film.cameras.push_back({fmt::format("{:05d}", i),
                            with_pose(without_lens(cameras[path.lens].camera), path.poses[i])});
  return film;
}

}  // namespace gs
