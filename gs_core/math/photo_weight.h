// SPDX-License-Identifier: Apache-2.0
// Stage 5: what a photo with a mask or an exposure of its own is compared as.
#pragma once

#include "gs_core/types.h"

namespace gs {

/// The loss compares X' = gain X and Y' = cover Y + backdrop, X the rendered picture, Y the photo, and
/// dL/dX = gain dL/dX'.
template <class T>
struct PhotoWeight {
  T gain, cover, backdrop;
};

/// One value of a photo whose pixel is trained by the share m, in 0..1, and that shows e times the scene's colours.
///
///   the mask says what trains      X' = m e X,  Y' = m Y                       black where nothing trains, in both
///   the mask says what is covered  X' = e X,    Y' = m Y + (1 - m) e b         all trains, over the background b
///
/// As common; Porter & Duff 1984 ("over") for the latter. m = 1 and e = 1 leave both pictures as they are.
template <class T>
GS_HD PhotoWeight<T> photo_weight(T m, T e, T b, bool over_background) {
  if (over_background) return {e, m, (T(1) - m) * (e * b)};
  return {m * e, m, T(0)};
}

}  // namespace gs
