// SPDX-License-Identifier: Apache-2.0
// The depth map that a view is trained on: read, and seen by the view's camera.
#pragma once

#include "data_loaders/scene/photo.h"

namespace gs {

/// The values of a view's map, (height, width, 1) of its camera, 0 where nothing is known. World
/// units if the photo says that it is metric, else as in the file. Throws Error that names the file.
/// The photo has a depth file.
ImageF make_depth(const Photo& photo);

/// What a view is trained on.
struct DepthMap {
  ImageF values;
  DepthKind kind;
};
/// make_depth(), and in world units wherever the sparse points tell scale and shift of the map: it
/// is metric then.
DepthMap make_depth_map(const Photo& photo);

/// The value of a map at a position between its pixels, where the center of the first pixel is
/// (0, 0). Four neighbors that are known and differ by less than a tenth are interpolated. Else
/// there may be an edge between them, and a mean of both sides would be the depth of nothing: the
/// nearest one counts. Beyond its border the map continues with its border pixels.
float depth_at(const ImageF& map, double x, double y);

}  // namespace gs
