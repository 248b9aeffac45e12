// SPDX-License-Identifier: Apache-2.0
// Bundle adjustment: poses, lenses and points of a model are moved until points land where their photos show them.
#pragma once

#include <functional>

#include "data_loaders/colmap/colmap_model.h"
#include "gs_core/scene.h"

namespace gs {

/// Called after each step of the solver, at the end with `step` at `most_steps`. Steps may begin anew once.
using RefinementProgress = std::function<void(std::size_t step, std::size_t most_steps)>;

/// Refines a model that was read with its observations, by least squares over all of them (Triggs et al. 2000).
///
///   lenses   all parameters of the camera's own model, with a weak prior on what they were, which decides only where the
///            photos do not: focal lengths 10 %, centers 1 % of the longer side, coefficients 0.1
///   poses    of frames: images that a rig took at one moment keep their poses to one another
///   loss     Cauchy, 1 pixel: what is farther off than features are found (0.3 to 0.5 pixels) is a wrong match, and
///            the farther the less it counts; where the median is above 1 pixel, with a Huber loss first, which is convex
///   gauge    held by one frame while solving; then the cameras are brought back onto where they stood by the similarity that fits best,
///            so the scene keeps its place, scale and axes (with rigs, whose size is known, its scale as solved)
///
/// Points that fewer than two photos show, and frames with next to none, stay as they are. Where the solver fails, so does
/// the whole model, with a warning. One thread, and so the same everywhere, up to `kObservationsOfOneThread`
/// observations; all threads beyond, where the last digits depend on their number.
/// Throws Error for a model without tracks, and for cameras that no photo can be undistorted of. Only where can_refine().
CameraRefinement refine_cameras(ColmapModel& model, const RefinementProgress& progress = {});

inline constexpr std::size_t kObservationsOfOneThread = 2000000;

}  // namespace gs
