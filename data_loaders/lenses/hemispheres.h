// SPDX-License-Identifier: Apache-2.0
// Panoramas of 360 degrees (EQUIRECTANGULAR) as two fisheye pictures of one place: one around the
// panorama's center, one around the way back. Neither has a seam or a pole, and both together have
// the fewest pixels.
//
//   column = (atan2(x, z) / 2 pi + 1/2) width,   row = (atan2(y, |(x, z)|) / pi + 1/2) height
#pragma once

#include "data_loaders/lenses/lens.h"
#include "gs_core/image.h"

namespace gs {

/// Where one of the two shows a direction of the panorama: the one ahead has those with z > 0.
struct HemispherePixel {
  bool is_back;
  Vec2d pixel;  // the center of the first at (0.5, 0.5)
};
HemispherePixel hemisphere_pixel(const ColmapCamera& panorama, const Vec2d& pixel);

/// The picture with each row averaged over the length that makes it as sharp as the equator: near
/// the poles neighbors show almost the same, and sampling them would choose one by chance.
Image8 evened_panorama(const Image8& panorama);

/// One of the two fisheye pictures, resampled bicubically. `hemisphere` is lens_camera() of an
/// EQUIRECTANGULAR camera of the picture's size. Throws Error as undistorted_photo() does.
Image8 hemisphere_of(const Image8& panorama, const LensCamera& hemisphere, bool is_back,
                     const std::string& photo);

/// The picture of a pinhole at the panorama's place, resampled bicubically. Its rotation is from the
/// panorama's frame. Throws Error as hemisphere_of().
Image8 pinhole_of(const Image8& panorama, const PinholeCamera<double>& camera,
                  const std::string& photo);

/// The pixel of a panorama of this size that shows a direction.
Vec2d panorama_pixel(const Vec3d& direction, int width, int height);

}  // namespace gs
