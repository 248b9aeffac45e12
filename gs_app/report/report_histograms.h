// SPDX-License-Identifier: Apache-2.0
// The histograms of a report: how opaque and how large the Gaussians of a model are.
#pragma once

#include <nlohmann/json.hpp>

#include "gs_core/gaussians.h"

namespace gs {

/// {"count", "opacity": {"from", "to", "counts", "median"}, "scales": [{"name": "longest", the same}, {"name":
/// "shortest", ...}], "out_of_range"}. Opacity is from 0 to 1; scales are log10 of the standard deviations along a Gaussian's longest and
/// shortest axis, in world units, over a range that leaves the outermost thousandth on either side to the last bars.
/// "out_of_range": Gaussians with a NaN or infinity, which are left out.
nlohmann::ordered_json model_histograms(const GaussianModel& model);

}  // namespace gs
