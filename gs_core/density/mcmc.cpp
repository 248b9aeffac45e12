// SPDX-License-Identifier: Apache-2.0
// The method "mcmc": Gaussians are samples, which noise moves around; dead ones are moved onto live
// ones, and copies are added up to density.max_gaussians.                  Kheradmand et al. 2024
//
// gs_train/density/mcmc.cpp carries it out; its numbers are settings of the preset mcmc.
#include "gs_core/density/growth_method.h"

namespace gs {

GrowthMethod mcmc_method() {
  GrowthMethod method;
  method.relocates = true;
  method.opacity = {};  // opacities are never lowered
  return method;
}

}  // namespace gs
