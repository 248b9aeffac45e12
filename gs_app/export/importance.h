// SPDX-License-Identifier: Apache-2.0
// How much the pictures of some views answer to each Gaussian's color and shape, for formats whose
// codebooks are weighted by that.   Niedermayr et al. 2024, "sensitivity"
#pragma once

#include "gs_app/export/fidelity.h"
#include "gs_model/formats/npz/npz.h"

namespace gs {

/// Renders each of these cameras forward and backward, with dL/d(pixel) = 1 in all channels and a
/// black background. `host` is the original of the viewpoints in host memory. Shows a progress bar
/// where that takes a while. Throws Error as the renderer does.
RowImportance importance_of(const Viewpoints& viewpoints, const Gaussians& host,
                            const std::vector<Camera>& cameras);

}  // namespace gs
