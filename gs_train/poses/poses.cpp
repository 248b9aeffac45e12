// SPDX-License-Identifier: Apache-2.0
#include "gs_train/poses/poses.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "gs_core/error.h"
#include "gs_core/math/render/projection.h"

namespace gs {
namespace {

constexpr std::size_t kMostPointsLookedAt = 10000;  // of the scene's, for each camera

// The rows of the photos, in the order in which the photos name them.
std::vector<std::uint32_t> rows_of(const std::vector<View>& views) {
  std::map<std::uint32_t, std::uint32_t> row_of_frame;
  std::vector<std::uint32_t> rows;
  std::uint32_t next = 0;
  for (const View& view : views) {
    const bool is_new =
        view.rig_frame == 0 || row_of_frame.try_emplace(view.rig_frame, next).second;
    rows.push_back(is_new ? next++ : row_of_frame.at(view.rig_frame));
  }
  return rows;
}

// Where a camera looks: the point on its axis at the median depth of what it sees. Its own center
// where it sees no point.
Vec3d focus_of(const PinholeCamera<double>& camera, const std::vector<ScenePoint>& points) {
  std::vector<double> depths;
  const std::size_t stride = points.size() / kMostPointsLookedAt + 1;
  for (std::size_t i = 0; i < points.size(); i += stride) {
    const Vec3d p = to_camera(camera, Vec3d(points[i].position));
    if (p.z <= 0 || !is_in_sight(camera, p)) continue;
    const Vec2<double> pixel = pixel_of(camera, p);
    if (pixel.x >= 0 && pixel.y >= 0 && pixel.x <= camera.width && pixel.y <= camera.height)
      depths.push_back(p.z);
  }
  if (depths.empty()) return camera.position();
  const auto middle = depths.begin() + std::ptrdiff_t(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return camera.position() + *middle * camera.cam_from_world_rotation.row2;
}

// A frame has the axes of its first camera. It turns about the mean of the points that its cameras
// look at: there a turn moves pictures as no shift does, so that Adam finds both at their own
// rates. About a camera's own center, both would move them nearly alike.
void take_frames(const Scene& scene, PoseFrames& state) {
  const std::vector<View>& views = scene.train_views;
  state.extent = double(scene.extent);
  state.row_of = rows_of(views);
  const std::size_t rows = *std::max_element(state.row_of.begin(), state.row_of.end()) + 1;
  std::vector<int> photos(rows, 0);
  state.centers.assign(rows, Vec3d(0.0));
  state.frames.assign(rows, {{}, Vec3d(0.0)});
  for (std::size_t i = 0; i < views.size(); ++i) {
    const auto camera = camera_as<double>(views[i].camera);
    const std::uint32_t row = state.row_of[i];
    if (photos[row]++ == 0) state.frames[row].axes = camera.cam_from_world_rotation;
    state.frames[row].pivot += focus_of(camera, scene.points);
    state.centers[row] += camera.position();
  }
  for (std::size_t row = 0; row < rows; ++row) {
    state.frames[row].pivot /= double(photos[row]);
    state.centers[row] /= double(photos[row]);
  }
}

}  // namespace

void begin_poses(const Config& config, const Scene& scene, TrainingModel& model) {
  if (!config.poses.refine) return;
  PoseState& state = model.poses;
  take_frames(scene, state);
  if (state.empty()) state.begin(state.frames.size(), kPoseNumbers);
  if (state.rows != state.frames.size())
    throw Error(fmt::format(
        "the state of the run has refined poses of {} photos or rig frames, but {} has {}; train "
        "on the scene of the run, or start a new run in another folder (-o)",
        state.rows, scene.source, state.frames.size()));
  std::vector<double> modes;
  for (const std::vector<double>& mode : common_modes(state))
    modes.insert(modes.end(), mode.begin(), mode.end());
  state.modes.upload(modes);
}

Camera refined_camera(const PoseState& state, const Camera& given, std::size_t photo) {
  if (state.empty()) return given;
  const std::size_t row = state.row_of[photo];
  return camera_as<float>(moved(camera_as<double>(given), state.frames[row], state.motion(row)));
}

std::vector<Camera> refined_cameras(const PoseState& in_any_memory,
                                    const std::vector<View>& train_views) {
  const PoseState state = copy_to(host_memory(), in_any_memory);
  std::vector<Camera> cameras;
  for (std::size_t i = 0; i < train_views.size(); ++i)
    cameras.push_back(refined_camera(state, train_views[i].camera, i));
  return cameras;
}

void add_pose_gradient(const PoseState& state, std::size_t photo, const Camera& given,
                       const CameraGradient<double>& dL, double weight,
                       std::vector<double>& gradient) {
  const std::size_t row = state.row_of[photo];
  const RigidMotion<double> by_motion =
      moved_vjp(camera_as<double>(given), state.frames[row], state.motion(row), dL);
  double* const of_row = gradient.data() + kPoseNumbers * row;
  for (int k = 0; k < 3; ++k) {
    of_row[k] += weight * by_motion.turn[k];
    of_row[3 + k] += weight * state.extent * by_motion.shift[k];
  }
}

PhotoPulls pose_pulls(const PoseState& state) {
  PhotoPulls pulls;
  for (std::size_t k = 0; k < kPoseNumbers; ++k)
    pulls[k] = {kPosePull / double(state.rows), k < 3 ? kPoseSpreadTurn : kPoseSpreadShift};
  return pulls;
}

PoseChange pose_change(const PoseState& in_any_memory, const std::vector<View>& train_views) {
  const PoseState state = copy_to(host_memory(), in_any_memory);
  double angles = 0, shifts = 0;
  for (std::size_t i = 0; i < train_views.size(); ++i) {
    const std::size_t row = state.row_of[i];
    const auto given = camera_as<double>(train_views[i].camera);
    const RigidMotion<double> motion = state.motion(row);
    const Vec3d shift = moved(given, state.frames[row], motion).position() - given.position();
    angles += inner(motion.turn, motion.turn);
    shifts += inner(shift, shift);
  }
  const double count = double(train_views.size());
  return {std::sqrt(angles / count) * 180 / std::numbers::pi, std::sqrt(shifts / count)};
}

}  // namespace gs
