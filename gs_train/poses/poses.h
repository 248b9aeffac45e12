// SPDX-License-Identifier: Apache-2.0
// Poses of training photos that are refined while training: their start, the camera of a photo, one
// update, and what they have in common. docs/method/poses.md explains the method.
#pragma once

#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/math/update/adam.h"
#include "gs_core/scene.h"
#include "gs_train/training_model.h"

namespace gs {

/// Gives the model the motions that poses.refine learns: zeros. Does nothing without that setting.
/// Where the motions are there already, gives them what follows from the scene. Throws Error where
/// those are of other photos.
void begin_poses(const Config& config, const Scene& scene, TrainingModel& model);

/// The camera of a training photo as it is now; `given`, that of its view, where nothing is
/// learned.
Camera refined_camera(const PoseState& state, const Camera& given, std::size_t photo);
/// The cameras of all training photos.
std::vector<Camera> refined_cameras(const PoseState& state, const std::vector<View>& train_views);

/// gradient += weight * dL/d(numbers) of the row of a photo, of which `dL` is the gradient by its
/// camera as it is now.
///
/// given     the photo's camera before it was refined
/// gradient  (rows, 6)
void add_pose_gradient(const PoseState& state, std::size_t photo, const Camera& given,
                       const CameraGradient<double>& dL, double weight,
                       std::vector<double>& gradient);

/// One update of all rows: adds the gradient of the pull to that of the data, and takes a step of
/// Adam, also for photos that were not shown; their moments move them on. Then what all photos have
/// in common is taken out of their motions.
void update_poses(PoseState& state, float rate, const AdamRule& rule,
                  std::vector<double>& gradient);

/// Takes out of the motions what a similarity of all cameras explains, by least squares, where
/// turns in radians and shifts in extents count alike: what all photos have in common is the
/// scene's.
void center_poses(PoseState& state);
/// PoseState::common_modes, of the state's frames.
std::vector<std::vector<double>> common_modes(const PoseState& state);

/// How far the cameras of training photos were moved, as root mean squares.
struct PoseChange {
  double degrees = 0;
  double shift = 0;  // of the centers, world units
};
PoseChange pose_change(const PoseState& state, const std::vector<View>& train_views);

}  // namespace gs
