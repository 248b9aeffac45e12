// SPDX-License-Identifier: Apache-2.0
#include "gs_core/scene.h"

#include <algorithm>
#include <cmath>

#include "gs_core/math/constants.h"

namespace gs {

float camera_extent(const std::vector<View>& views) {
  Vec3d mean(0.0);
  for (const View& view : views) mean += Vec3d(view.camera.position());
  mean /= double(std::max<std::size_t>(views.size(), 1));
  double farthest = 0;
  for (const View& view : views) {
    const Vec3d offset = Vec3d(view.camera.position()) - mean;
    farthest = std::max(farthest, std::sqrt(inner(offset, offset)));
  }
  return farthest > 0 ? kExtentMargin * float(farthest) : 1.0f;
}

}  // namespace gs
