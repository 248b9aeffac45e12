// SPDX-License-Identifier: Apache-2.0
// Stage 5: the values that the loss compares if a view has a mask or an exposure.
#pragma once

#include "gs_core/types.h"

namespace gs {

/// The loss compares X' = gain X and Y' = cover Y + backdrop, X the rendered picture, Y the photo,
/// and dL/dX = gain dL/dX'.
template <class T>
struct PhotoWeight {
  T gain, cover, backdrop;
};

/// For one value of a photo: m in 0..1 is the mask of its pixel, and the photo shows e times the
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

/// The value that X' is compared with. It is Y', with one exception: if the photo's value Y is at
/// least `white` and X' is brighter still, it is X' itself, so that loss and gradient are zero. A
/// white pixel is only a lower bound of the brightness: a sky is as white in a dark photo as in a
/// bright one, and no gain explains both. For photos without an exposure `white` is above 1, so the
/// exception never applies.
template <class T>
GS_HD T compared_photo(T x_weighted, T y_weighted, T y, T white) {
  return y >= white && x_weighted > y_weighted ? x_weighted : y_weighted;
}

}  // namespace gs
