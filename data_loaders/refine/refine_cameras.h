// SPDX-License-Identifier: Apache-2.0
// Bundle adjustment: moves poses, lenses and points of a model until the points land on the pixels
// where photos show them.
#pragma once

#include <functional>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/scene.h"

namespace gs {

/// Called after each step of the solver, and at the end with `step` = `most_steps`. The count may
/// start again once, when a second loss follows the first.
using RefinementProgress = std::function<void(std::size_t step, std::size_t most_steps)>;

/// Refines a model that was read with its observations, by least squares over all of them (Triggs
/// et al. 2000).
///
///   lenses   all parameters of the camera's own model, with a weak prior at their old values:
///            focal lengths 10 %, centers 1 % of the longer side, coefficients 0.1
///   poses    of frames: images that a rig took at one moment keep their poses relative to each
///            other
///   loss     Cauchy with 1 pixel. Features are found to 0.3 to 0.5 pixels; larger errors are
///            mostly wrong matches and count less the larger they are. Where the median is above 1
///            pixel, a Huber loss, which is convex, comes first.
///   gauge    one frame is held while solving. Then the best similarity moves the cameras back to
///            where they stood, so the scene keeps its place, scale and axes. Rigs have a known
///            size and keep the scale of the solution.
///
/// Points in fewer than two photos, and frames with fewer than ten observations, stay as they are.
/// If the solver fails, the whole model stays as it is, with a warning.
/// Up to `kObservationsOfOneThread` observations it takes one thread, and the result is the same
/// everywhere; with more it takes all threads, and the last digits depend on their number.
/// Throws Error for a model without tracks, and for cameras whose photos cannot be undistorted.
/// Only where can_refine().
CameraRefinement refine_cameras(ColmapModel& model, const RefinementProgress& progress = {});

inline constexpr std::size_t kObservationsOfOneThread = 2000000;

}  // namespace gs
