// SPDX-License-Identifier: Apache-2.0
// What a file of a given size keeps of a model: fewer Gaussians, a lower SH degree, or both.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "gs_app/export/fidelity.h"
#include "gs_core/gaussians.h"

namespace gs {

/// Bytes of the file that a model would become.
using FileSize = std::function<std::uint64_t(const GaussianModel&)>;

/// The model, or what is left of it after merges (decimate.h) and without the upper degrees of SH
/// so that `size_of` is at most `bytes`. For each degree as many Gaussians stay as fit. Of these
/// models the one whose pictures are nearest to the original's on the viewpoints' cameras is taken,
/// and without cameras the one with the highest degree that leaves enough Gaussians: half of them
/// for degree 3, a fifth for 2 and a tenth for 1. `viewpoints` may be null, and its original is `model`. Shows a progress bar.
/// Throws UsageError, which begins with `file`, where fewer than a hundred Gaussians would be left,
/// and where Gaussians in space and time, which are not merged, do not fit with degree 0.
GaussianModel fit_size(const GaussianModel& model, std::uint64_t bytes, const FileSize& size_of,
                       const Viewpoints* viewpoints, const std::string& file);

}  // namespace gs
