// SPDX-License-Identifier: Apache-2.0
// Gaussians without their 3D filter that look as they do with it, for programs that know none.
#pragma once

#include "gs_core/gaussians.h"

namespace gs {

/// Puts the filter into scales and opacities and drops its array (math/filter_3d.h):
///
///   s_k' = sqrt(s_k^2 + f^2)        o' = o sqrt(prod s_k^2 / (s_k^2 + f^2))       Yu et al. 2024
///
/// Host memory only. Rows with f = 0 keep their bits, and so do all where there is no filter.
void bake_filter(Gaussians& gaussians);

}  // namespace gs
