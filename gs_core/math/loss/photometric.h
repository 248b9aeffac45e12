// SPDX-License-Identifier: Apache-2.0
// Between stages 4 and 5: how a photo shows the scene's colors (photometric.model). The formulas of
// each model stand here, and gs_train/photometric/ has the table of models.
#pragma once

#include "gs_core/types.h"

namespace gs {

/// The model "gains", one channel of a pixel: a is the log gain of the photo, which shows
///
///   y = exp(a) x
template <class T>
GS_HD T gained(T x, T a) {
  using std::exp;
  return exp(a) * x;
}

template <class T>
struct GainedGradient {
  T x, a;
};
/// `gain` is exp(a), `y` is gained(x, a).
///
///   dL/dx = gain G,   dL/da = G y
template <class T>
GS_HD GainedGradient<T> gained_vjp(T y, T gain, T dL_dy) {
  return {gain * dL_dy, dL_dy * y};
}

}  // namespace gs
