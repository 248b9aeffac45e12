// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/pose_file.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <numbers>

#include "gs_core/error.h"
#include "gs_core/geometry/vectors.h"
#include "gs_core/system/byte_reader.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/text/foreign_text.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/text/read_json.h"

namespace gs {
namespace {

// float as the number type: written with the digits that a float needs. Keys are sorted.

constexpr const char* kRemedyOfPoses =
    "train again, or remove the file to measure training photos at their given poses";
constexpr float kRotationTolerance = 1e-3f;  // of inner products of rows

/// Between two poses.
struct Difference {
  double degrees, shift;
};
Difference difference_of(const Camera& a, const Camera& b) {
  const auto in_a = camera_as<double>(a), in_b = camera_as<double>(b);
  const Mat3<double>&A = in_a.cam_from_world_rotation, &B = in_b.cam_from_world_rotation;
  const Vec3d x = A.row0 - B.row0, y = A.row1 - B.row1, z = A.row2 - B.row2;
  const double chord = std::sqrt((inner(x, x) + inner(y, y) + inner(z, z)) / 8);
  return {2 * std::asin(std::min(1.0, chord)) * 180 / std::numbers::pi,
          length(in_a.position() - in_b.position())};
}

SortedFloatJson list_of(const Vec3f& v) { return SortedFloatJson::array({v.x, v.y, v.z}); }

Vec3f vector_in(const SortedFloatJson& list) {
  return {list.at(0).get<float>(), list.at(1).get<float>(), list.at(2).get<float>()};
}

RefinedPose pose_in(const SortedFloatJson& photo) {
  const SortedFloatJson& rows = photo.at("rotation");
  return {{vector_in(rows.at(0)), vector_in(rows.at(1)), vector_in(rows.at(2))},
          vector_in(photo.at("translation"))};
}

}  // namespace

void write_poses(const std::filesystem::path& path, const std::vector<View>& train_views,
                 const std::vector<Camera>& refined) {
  SortedFloatJson photos = SortedFloatJson::object();
  double angles = 0, shifts = 0;
  for (std::size_t i = 0; i < train_views.size(); ++i) {
    const Mat3<float>& R = refined[i].cam_from_world_rotation;
    const Difference moved = difference_of(refined[i], train_views[i].camera);
    angles += moved.degrees * moved.degrees;
    shifts += moved.shift * moved.shift;
    photos[train_views[i].name] = {
        {"rotation", {list_of(R.row0), list_of(R.row1), list_of(R.row2)}},
        {"translation", list_of(refined[i].cam_from_world_translation)},
        {"degrees", float(moved.degrees)},
        {"shift", float(moved.shift)}};
  }
  const double count = double(train_views.size());
  const SortedFloatJson json = {{"degrees", float(std::sqrt(angles / count))},
                                {"shift", float(std::sqrt(shifts / count))},
                                {"photos", std::move(photos)}};
  AtomicFile file(path);
  file.write(json.dump(1, ' ', false, SortedFloatJson::error_handler_t::replace) + "\n");
  file.commit();
}

RefinedPoses read_poses(const std::filesystem::path& path) {
  const SortedFloatJson json = read_json_as<SortedFloatJson>(path, kRemedyOfPoses);
  RefinedPoses poses = take_from_json(path, kRemedyOfPoses, [&] {
    RefinedPoses poses;
    for (const auto& [name, photo] : json.at("photos").items()) poses[name] = pose_in(photo);
    return poses;
  });
  for (const auto& [name, pose] : poses)
    if (!is_rotation(pose.cam_from_world_rotation, kRotationTolerance) ||
        !is_finite(pose.cam_from_world_translation))
      cannot_read(path, fmt::format("the pose of '{}' is no rotation and translation; {}",
                                    shown_word(name), kRemedyOfPoses));
  return poses;
}

void apply_poses(const RefinedPoses& poses, Scene& scene) {
  for (View& view : scene.train_views) {
    const auto found = poses.find(view.name);
    if (found == poses.end()) continue;
    view.camera.cam_from_world_rotation = found->second.cam_from_world_rotation;
    view.camera.cam_from_world_translation = found->second.cam_from_world_translation;
  }
}

}  // namespace gs
