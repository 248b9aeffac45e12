// SPDX-License-Identifier: Apache-2.0
// What an edit has changed, as a picture: the model before at the left, after at the right.
#pragma once

#include <optional>
#include <string>

#include "gs_app/edit/selection.h"
#include "gs_core/image.h"

namespace gs {

/// A camera in front of a model, in the frame of its numbers: it looks along z, a little down, at
/// the median of the means. -y is at the top, as in viewers. Nine in ten means are in the picture.
Camera camera_before(const GaussianModel& model);

/// Renders the model before the first operation when it is made, and the model after the last one
/// in beside().
///
/// `camera_name` is that of a camera of both, which moves with the model. If it is empty, pictures
/// are those of camera_before(): of each model its own where it was moved in between, else of the
/// model before. Throws UsageError where there is no such camera.
class EditPicture {
 public:
  EditPicture(const EditModel& before, const EditTools& tools, std::string camera_name);

  /// Both pictures side by side.
  Image8 beside(const EditModel& after) const;

 private:
  const EditTools& tools_;
  std::string camera_name_;
  Camera camera_;
  std::optional<Mat4d> frame_;
  Image8 left_;
};

}  // namespace gs
