// SPDX-License-Identifier: Apache-2.0
// Whether a photo has the shape of its camera in the model.
#pragma once

#include <cmath>

#include "data_loaders/photos/photos.h"

namespace gs {

enum class PhotoFit {
  fits,    // the camera's shape to a pixel, perhaps another size
  turned,  // width and height are swapped: an EXIF orientation was followed once
  other,   // another shape: not the photo that COLMAP saw
};

/// Whether a picture of size a has the shape of one of size b, to a pixel.
inline bool has_shape_of(const PhotoSize& a, const PhotoSize& b) {
  const double by_height = double(b.width) * a.height / b.height;
  const double by_width = double(b.height) * a.width / b.width;
  return std::abs(a.width - by_height) <= 1 || std::abs(a.height - by_width) <= 1;
}

inline PhotoFit fit_of(const PhotoSize& photo, const PhotoSize& camera) {
  return has_shape_of(photo, camera)                          ? PhotoFit::fits
         : has_shape_of(photo, {camera.height, camera.width}) ? PhotoFit::turned
                                                              : PhotoFit::other;
}

}  // namespace gs
