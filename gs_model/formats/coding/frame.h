// SPDX-License-Identifier: Apache-2.0
// Half turns about an axis: they take Gaussians from COLMAP's axes (x right, y down, z forward) to
// those of formats with y up. They are exact, since only signs change.
#pragma once

#include <cstdint>

#include "gs_core/gaussians.h"

namespace gs {

/// Signs of x, y and z under a half turn; two of them are -1.
using AxisSigns = Vec3f;
inline const AxisSigns kHalfTurnX{1, -1, -1};
inline const AxisSigns kHalfTurnZ{-1, -1, 1};

/// The sign that SH coefficient k of ShRest gets under these signs of the axes. Each basis function
/// of math/sh.h is even or odd in each of x, y and z; the table lists the axes in which it is odd.
inline float sh_sign(int k, const AxisSigns& signs) {
  constexpr int x = 1, y = 2, z = 4;
  constexpr std::uint8_t kOdd[kShRestCount] = {y,         z,     x,  //
                                               x | y,     y | z, 0, x | z, 0, y,
                                               x | y | z, y,     z, x,     z, x};
  return (kOdd[k] & x ? signs.x : 1.0f) * (kOdd[k] & y ? signs.y : 1.0f) *
         (kOdd[k] & z ? signs.z : 1.0f);
}

}  // namespace gs
