// SPDX-License-Identifier: Apache-2.0
// A number that is learned of a photo stays near the value that it began with.
#pragma once

#include "gs_core/types.h"

namespace gs {

/// dL/da of the loss
///
///   weight/2 ((a - start) / spread)^2
template <class T>
GS_HD T pull_vjp(T a, T start, T weight, T spread) {
  return weight * (a - start) / (spread * spread);
}

}  // namespace gs
