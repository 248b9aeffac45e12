// SPDX-License-Identifier: Apache-2.0
// The lenses that `gemsplat render --lens` puts in front of cameras: fisheyes and parallel rays are
// drawn as they are, a panorama is put together from two fisheyes.
#pragma once

#include <vector>

#include "gs_app/export/view_pictures.h"
#include "gs_core/camera.h"

namespace gs {

/// An equidistant fisheye, `degrees` across the picture's width. Throws UsageError where a corner
/// would lie behind kLargestAngle.
Camera with_fisheye(Camera camera, double degrees);

/// Parallel rays, `width` world units across the picture.
Camera with_parallel_rays(Camera camera, double width);

/// The camera of a panorama (hemispheres.h) at the same place: level, and ahead where the camera
/// looks. Its width is as sharp as the camera's center and at most kWidestPanorama, or `width` if
/// that is not 0. Both sides are even.
///
/// up   unit length
Camera panorama_camera(const Camera& camera, const Vec3d& up, int width);
inline constexpr int kWidestPanorama = 4096;  // pixels, unless --size says otherwise; H.264's limit

/// The quantities of a panorama, from two fisheyes that are drawn finer and overlap by 10 degrees:
/// there colors and alpha go over smoothly from one to the other. Depth is that of the nearest
/// pixel, along the ray.
std::vector<ImageF> panorama_values(ViewPictures& pictures, const Camera& panorama,
                                    const std::vector<Quantity>& quantities);

}  // namespace gs
