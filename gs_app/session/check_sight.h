// SPDX-License-Identifier: Apache-2.0
// Refuses runs whose pictures would all be empty.
#pragma once

#include "gs_train/loop/trainer.h"

namespace gs {

/// Looks at the Gaussians of a run before its first step. Throws Error if no view could show any of
/// them, whatever is learned; warns if most views show none.
void check_sight(Trainer& trainer);

}  // namespace gs
