// SPDX-License-Identifier: Apache-2.0
// The method "adaptive": Gaussians whose mean image-plane gradient is large are cloned or split, faint
// and huge ones are pruned, and opacities are reset.                   Kerbl et al. 2023, Sec. 5.2
//
// The paper's thresholds and steps are settings of the preset adaptive.
#include "gs_core/density/growth_method.h"

namespace gs {

GrowthMethod adaptive_method() { return {}; }

}  // namespace gs
