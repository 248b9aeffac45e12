// SPDX-License-Identifier: Apache-2.0
// The exposures of a scene's views, from the points that its photos share (refine_exposure.h).
#pragma once

#include <vector>

#include "data_loaders/refine/refine_exposure.h"
#include "data_loaders/refine/tracks.h"
#include "gs_core/scene.h"

namespace gs {

/// Solves for the exposures of all views, and changes nothing. `seen` and `is_test` have one entry
/// per view. Only for builds that can_refine().
ExposureFit fit_view_exposures(const std::vector<ScenePoint>& points,
                               const std::vector<std::vector<SeenPoint>>& seen,
                               const std::vector<bool>& is_test, const std::vector<View>& views);

/// Sets View::exposure of all views, to those of `fit`, and logs the result. Warns of photos that
/// share too few points with others; their exposure stays 1.
ExposureSummary take_exposures(const ExposureFit& fit, std::vector<View>& views);

}  // namespace gs
