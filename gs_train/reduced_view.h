// SPDX-License-Identifier: Apache-2.0
// The view of a step that trains on a reduced photo. Its GPU twin is in cuda/step/photos.cu.
#pragma once

#include "gs_core/scene.h"

namespace gs {

/// The view with camera, photo, mask and depth map reduced `factor` times (math/area_filter.h); all
/// else is that of `view`, which has its photo.
View reduced_view(const View& view, int factor);

}  // namespace gs
