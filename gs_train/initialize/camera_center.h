// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "gs_core/scene.h"

namespace gs {

/// The mean position of the cameras of views, of which there is at least one; world units.
inline Vec3f camera_center(const std::vector<View>& views) {
  Vec3f center(0.0f);
  for (const View& view : views) center += view.camera.position();
  return center / float(views.size());
}

}  // namespace gs
