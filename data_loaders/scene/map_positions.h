// SPDX-License-Identifier: Apache-2.0
// Where a map of a photo, of depths or of normals, has what the view's camera sees.
#pragma once

#include "data_loaders/scene/photo.h"

namespace gs {

/// Positions in a map of this size. All of them have pixel centers at + 0.5.
class MapPositions {
 public:
  MapPositions(const Photo& photo, const PhotoSize& map) : photo_(photo), map_(map) {}

  /// That of a position in the view.
  Vec2d at(double x, double y) const {
    const PinholeCamera<double>&target = photo_.target, &whole = photo_.undistorted;
    Vec2d at(x * whole.width / target.width, y * whole.height / target.height);
    if (photo_.is_undistorted()) {
      const PinholeCamera<double>& lens = photo_.lens.pinhole;
      const Vec2d landed =
          distorted(photo_.lens, {(at.x - whole.cx) / whole.fx, (at.y - whole.cy) / whole.fy});
      at = {lens.fx * landed.x + lens.cx, lens.fy * landed.y + lens.cy};
    }
    return {at.x * map_.width / photo_.size.width, at.y * map_.height / photo_.size.height};
  }

 private:
  const Photo& photo_;
  PhotoSize map_;
};

}  // namespace gs
