// SPDX-License-Identifier: Apache-2.0
// Camera models with a lens: from a ray of the ideal pinhole to its pixel in the photo, and back.
#pragma once

#include <optional>
#include <string>

#include "data_loaders/colmap/colmap_model.h"
#include "data_loaders/lenses/lens_formulas.h"
#include "gs_core/camera.h"

namespace gs {

using Vec2d = Vec2<double>;

/// A COLMAP camera written out: an ideal pinhole, and the lens in front of it. Points are in
/// normalized coordinates u = (x, y) = (X / Z, Y / Z), the pixel of the photo is
/// (fx x' + cx, fy y' + cy) for u' = (x', y') = distorted(u). lens_formulas.h has the formulas,
/// gs_core/lens.h the kinds of lenses.
struct LensCamera : LensCoefficients<double> {
  CameraModel model = CameraModel::pinhole;
  PinholeCamera<double> pinhole;  // of the photo: size, focal lengths, center; the pose is unused

  /// Whether it is one of the two halves of a panorama (hemispheres.h), which has a radius.
  bool is_hemisphere() const { return model == CameraModel::equirectangular; }
};

/// The remedy for a lens that gemsplat cannot undistort.
inline constexpr const char* kUndistortRemedy =
    "convert the photos with `colmap image_undistorter --image_path IMAGES --input_path MODEL "
    "--output_path NEW` and train on NEW";

/// The camera of a photo; of EQUIRECTANGULAR, that of its two halves. A lens with coefficients of 0
/// becomes Lens::none. Throws Error that names the model, the camera, the photo and the remedy for
/// focal lengths that are not positive and for an omega of FOV of 180 degrees and more.
LensCamera lens_camera(const ColmapCamera& camera, const std::string& photo);

/// The sides of a half of a panorama, pixels.
int hemisphere_side(int panorama_width);

/// The normalized point where the ray through `ideal` lands; NaN if the model has none.
Vec2d distorted(const LensCamera& camera, const Vec2d& ideal);

/// Whether the lens keeps left and right, up and down apart at `ideal` (determinant and trace of
/// its Jacobian are positive). Beyond the first place where it does not, the polynomial folds back
/// and no longer describes the lens.
bool is_unfolded(const LensCamera& camera, const Vec2d& ideal);

/// The point of the lens's chart (gs_core/lens.h) that lands at `landed`, by Newton's method or in
/// closed form; nothing if there is none before the lens folds.
std::optional<Vec2d> chart_point(const LensCamera& camera, const Vec2d& landed);

/// The ray that lands at `landed`, by Newton's method or in closed form; nothing if there is none
/// in front of the camera.
std::optional<Vec2d> undistorted(const LensCamera& camera, const Vec2d& landed);

}  // namespace gs
