// SPDX-License-Identifier: Apache-2.0
// The result of a reconstruction: how many photos were placed, and why the others were not.
#pragma once

#include "data_loaders/reconstruct/colmap_plan.h"

namespace gs {

/// Reads the largest model and the log of a finished scene.
Reconstruction verdict_of(const ColmapPlan& plan);

}  // namespace gs
