// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "gs_core/scene.h"

namespace gs {

/// What cameras look at together, in world units.
struct LookedAt {
  Vec3f center;
  float radius;  // of the sphere around it that fills the smaller side of the median picture
};

/// The point nearest to the optical axes of all cameras, by least squares. None if the axes are
/// nearly parallel, or if more than a tenth of the cameras do not see that point: the cameras then
/// look in different directions, as those inside of a room do.
std::optional<LookedAt> looked_at(const std::vector<View>& views);

}  // namespace gs
