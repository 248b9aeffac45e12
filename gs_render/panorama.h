// SPDX-License-Identifier: Apache-2.0
// Panoramas of 360 degrees, put together from two fisheyes that look ahead and back.
//
//   column = (atan2(x, z) / 2 pi + 1/2) width,   row = (atan2(y, |(x, z)|) / pi + 1/2) height
#pragma once

#include <array>

#include "gs_core/camera.h"
#include "gs_core/image.h"

namespace gs {

/// The two fisheyes of a panorama, ahead and behind, at its place: equidistant, half as fine again
/// as its equator, and up to kHemisphereReach from their axes, so that they overlap by 10 degrees.
/// Of `panorama`, width, pose and time count.
std::array<Camera, 2> panorama_halves(const Camera& panorama);

/// The panorama of what its halves show, of the panorama's size. Where they overlap, a picture that
/// `is_smooth` goes over from one to the other. Others, such as depth, have the values of the nearest
/// pixel.
ImageF joined_panorama(const Camera& panorama, const std::array<ImageF, 2>& halves, bool is_smooth);

}  // namespace gs
