// SPDX-License-Identifier: Apache-2.0
// Camera models with a lens: where a ray of the ideal pinhole lands in the photo, and the way back.
#pragma once

#include <optional>
#include <string>

#include "data_loaders/colmap_model.h"
#include "gs_core/camera.h"

namespace gs {

using Vec2d = Vec2<double>;

/// A COLMAP camera written out: an ideal pinhole, and the lens polynomial in front of it. Points
/// are in normalised coordinates (x, y) = (X / Z, Y / Z).
///
///   radial_tangential   r^2 = x^2 + y^2                             Brown 1966; OpenCV's naming
///     s = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
///     x' = s x + 2 p1 x y + p2 (r^2 + 2 x^2),   y' = s y + p1 (r^2 + 2 y^2) + 2 p2 x y
///   fisheye             theta = atan r                              Kannala & Brandt 2006
///     (x', y') = (x, y) / r * theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
///   photo pixel         (fx x' + cx, fy y' + cy)
struct LensCamera {
  enum class Lens { none, radial_tangential, fisheye };

  PinholeCamera<double> pinhole;  // of the photo: size, focal lengths, principal point; its pose is unused
  Lens lens = Lens::none;
  double k[6] = {};
  double p[2] = {};
};

/// What a user can do about a lens that gemsplat cannot undistort.
inline constexpr const char* kUndistortRemedy =
    "convert the photos with `colmap image_undistorter --image_path IMAGES --input_path MODEL "
    "--output_path NEW` and train on NEW";

/// The camera of a photo. A radial or tangential lens whose coefficients
/// are all zero is none. Throws Error that names
/// the model, the camera, the photo and the remedy for models that are none of the above, and for
/// focal lengths that are not positive.
LensCamera lens_camera(const ColmapCamera& camera, const std::string& photo);

/// Where the ray through `ideal` lands, normalised.
Vec2d distorted(const LensCamera& camera, const Vec2d& ideal);

/// Whether the lens keeps left and right, up and down apart at `ideal` (determinant and trace of
/// its Jacobian are positive). Beyond the first place where it does not, the polynomial folds back
/// and means nothing.
bool is_unfolded(const LensCamera& camera, const Vec2d& ideal);

/// The ray that lands at `landed`, by Newton's method; nothing where there is none in front of the
/// camera.
std::optional<Vec2d> undistorted(const LensCamera& camera, const Vec2d& landed);

}  // namespace gs
