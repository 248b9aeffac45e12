// SPDX-License-Identifier: Apache-2.0
// The exposures of a scene's views, from the points that its photos share (refine_exposure.h).
#pragma once

#include <vector>

#include "data_loaders/refine/tracks.h"
#include "gs_core/scene.h"

namespace gs {

/// Sets View::exposure of all views and logs the result. `seen` and `is_test` have one entry per
/// view. Warns of photos that share too few points with others; their exposure stays 1. Only for
/// builds that can_refine().
ExposureSummary solve_exposures(const std::vector<ScenePoint>& points,
                                const std::vector<std::vector<SeenPoint>>& seen,
                                const std::vector<bool>& is_test, std::vector<View>& views);

}  // namespace gs
