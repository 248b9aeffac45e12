// SPDX-License-Identifier: Apache-2.0
// Poses of training photos that are refined while training: their start, the camera of a photo, the
// pull, and what they have in common. docs/method/poses.md explains the method.
#pragma once

#include <vector>

#include "gs_core/config/config.h"
#include "gs_core/scene.h"
#include "gs_train/training_model.h"

namespace gs {

/// Gives the model the motions that poses.refine learns: zeros. Does nothing without that setting.
/// Where the motions are there already, gives them what follows from the scene. Throws Error where
/// those are of other photos.
void begin_poses(const Config& config, const Scene& scene, TrainingModel& model);

/// The camera of a training photo as it is now; `given`, that of its view, where nothing is
/// learned. The state is in host memory.
Camera refined_camera(const PoseState& state, const Camera& given, std::size_t photo);
/// The cameras of all training photos. The state may be in any memory.
std::vector<Camera> refined_cameras(const PoseState& state, const std::vector<View>& train_views);

/// gradient += weight * dL/d(numbers) of the row of a photo, of which `dL` is the gradient by its
/// camera as it is now.
///
/// given     the photo's camera before it was refined
/// gradient  (rows, 6)
void add_pose_gradient(const PoseState& state, std::size_t photo, const Camera& given,
                       const CameraGradient<double>& dL, double weight,
                       std::vector<double>& gradient);

/// The pull of all rows: the mean over them of |turn|^2 / (2 sigma^2), and the same of shifts.
PhotoPulls pose_pulls(const PoseState& state);

/// What a similarity makes of all motions, as orthonormal modes, at most 7 of (rows, 6), where turns
/// in radians and shifts in extents count alike.
std::vector<std::vector<double>> common_modes(const PoseFrames& frames);

/// How far the cameras of training photos were moved, as root mean squares. The state may be in any
/// memory.
struct PoseChange {
  double degrees = 0;
  double shift = 0;  // of the centers, world units
};
PoseChange pose_change(const PoseState& state, const std::vector<View>& train_views);

}  // namespace gs
