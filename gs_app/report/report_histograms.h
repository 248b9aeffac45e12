// SPDX-License-Identifier: Apache-2.0
// The histograms of a report: opacities and scales of the Gaussians of a model.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// {"count", "opacity": {"from", "to", "counts", "median"}, "scales": [{"name": "longest", the
/// same}, {"name": "shortest", ...}], "out_of_range"}. Opacity is from 0 to 1. Scales are log10 of
/// the standard deviations along a Gaussian's longest and shortest axis, in world units; the
/// outermost thousandth on either side is counted in the last bar. "out_of_range" is the number of
/// Gaussians with NaN or infinity, which are left out.
Json model_histograms(const GaussianModel& model);

}  // namespace gs
