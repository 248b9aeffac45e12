// SPDX-License-Identifier: Apache-2.0
// Stage 5: what a photo with a mask or an exposure of its own is compared as.
#pragma once

#include "gs_core/types.h"

namespace gs {

/// The loss compares X' = gain X and Y' = cover Y + backdrop, X the rendered picture, Y the photo,
/// and dL/dX = gain dL/dX'.
template <class T>
struct PhotoWeight {
  T gain, cover, backdrop;
};

/// One value of a photo whose pixel is trained by the share m, in 0..1, and that shows e times the
/// scene's colors.
///
///   the mask says what trains      X' = m e X,  Y' = m Y                       black where nothing trains, in both
///   the mask says what is covered  X' = e X,    Y' = m Y + (1 - m) e b         all trains, over the background b
///
/// As common; Porter & Duff 1984 ("over") for the latter. m = 1 and e = 1 leave both pictures as
/// they are.
template <class T>
GS_HD PhotoWeight<T> photo_weight(T m, T e, T b, bool over_background) {
  if (over_background) return {e, m, (T(1) - m) * (e * b)};
  return {m * e, m, T(0)};
}

/// What X' is compared with: Y', but X' itself, at no cost and with no gradient, where the photo's
/// value Y is `white` or more and X' is brighter still. There a photo says how bright its scene is
/// at least: a sky is as white in a dark photo as in a bright one, and no gain explains both.
/// Photos without an exposure have no such value; `white` is above 1 for them.
template <class T>
GS_HD T compared_photo(T x_weighted, T y_weighted, T y, T white) {
  return y >= white && x_weighted > y_weighted ? x_weighted : y_weighted;
}

}  // namespace gs
