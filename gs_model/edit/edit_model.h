// SPDX-License-Identifier: Apache-2.0
// A trained model that is being edited: rows are chosen, the whole is moved, its size is reduced.
// Its cameras move with it, and it remembers the way back to the photos' frame.
//
// Coordinates that users give are those of the model as it is at that moment: means plus world
// offset, in double precision.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_model/edit/decimate.h"
#include "gs_model/edit/model_transform.h"

namespace gs {

struct EditCamera {
  std::string name;  // of the photo, without extension
  Camera camera;
  bool is_test = false;  // of a view that training did not see
};

struct EditModel {
  GaussianModel model;
  std::optional<Mat4d> input_from_model;  // where it was moved before; else a shift
  std::vector<EditCamera> cameras;        // in the frame of the model's numbers
};

/// From the numbers of the model to the photos' frame.
Mat4d input_from(const EditModel& model);

/// Keeps these rows and no others.
void keep_rows(EditModel& model, const std::vector<std::uint32_t>& rows);

/// The transform x -> scale R (x - center) + center, which leaves `center` where it is.
ModelTransform transform_about(const Vec3d& center, const Quat<double>& turn, double scale);
/// The turn about the x axis, then about the y axis, then about the z axis.
Quat<double> turn_by_degrees(const Vec3d& degrees);

/// Moves the model and its cameras: `transform` is in the model's coordinates. A picture from a
/// camera that moves along stays as it is, if near and far plane are scaled, too. Throws UsageError
/// where Gaussians in space and time would be scaled.
void transform_edited(EditModel& model, const ModelTransform& transform);

/// The same for cameras alone.
void move_cameras(std::vector<EditCamera>& cameras, const ModelTransform& transform);

/// The same in the numbers of the model, without their world offset. The way to the photos' frame
/// stays true, also after a mere shift.
void transform_numbers(EditModel& model, const ModelTransform& transform);

/// The means of up to 100,000 Gaussians, evenly chosen, under a matrix.
std::vector<Vec3d> positions_under(const Mat4d& matrix, const Gaussians& gaussians);
/// What to take off such positions so that floats can hold them; 0 where they are near the origin.
Vec3d offset_of_positions(const std::vector<Vec3d>& positions);

/// How many times the model is as large as in the photos' frame.
double scale_of(const EditModel& model);

/// What straighten() did.
struct Straightened {
  double degrees = 0;  // between the up direction that was found and that of the model before
  double raised = 0;   // by how much the floor was below the middle, world units
  bool by_cameras = false;
};
/// Turns the model so that up is -y, as viewers show it, and moves it so that the floor is at y = 0
/// and the middle of the scene above the origin. Up and middle are those of the cameras
/// (scene_frame.h); without cameras up is that of level surfaces (upright.h) and the middle is the
/// median of the means. Throws UsageError where the cameras leave up unknown.
Straightened straighten(EditModel& model);

/// Brings a model that was moved back to the photos' frame; others stay as they are.
void restore_frame(EditModel& model);

/// A copy of the model in the photos' frame.
GaussianModel in_photos_frame(const EditModel& model);

/// Merges pairs of Gaussians until `count` are left (decimate.h). Throws UsageError for Gaussians
/// in space and time.
void decimate_by_merging(EditModel& model, std::size_t count, const DecimateOptions& options = {});

/// The Gaussians as pictures show them, for questions about size and opacity: with the 3D filter in
/// scales and opacities, and those in space and time in the middle of their lives. `storage` holds
/// them where they differ from the model's.
const Gaussians& drawn_gaussians(const GaussianModel& model, std::optional<Gaussians>& storage);

}  // namespace gs
