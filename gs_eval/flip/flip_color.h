// SPDX-License-Identifier: Apache-2.0
// The color spaces of FLIP and its distance between colors (Andersson et al. 2020). White is that of D65.
#pragma once

#include "gs_core/types.h"

namespace gs {

/// A value of display sRGB as linear light, both in [0, 1] (IEC 61966-2-1).
double linear_from_srgb(double value);

/// The opponent space in which FLIP filters: achromatic Y, red-green Cx, blue-yellow Cz.
Vec3d ycxcz_from_linear(const Vec3d& linear_rgb);

/// The inverse. Values outside of [0, 1] are colors that no display shows.
Vec3d linear_from_ycxcz(const Vec3d& ycxcz);

/// CIELab with a and b scaled by lightness, after Hunt: dark colors look less colorful.
Vec3d hunt_lab_from_linear(const Vec3d& linear_rgb);

/// Distance of two colors of that space: |dL| + sqrt(da^2 + db^2), "HyAB" (Abasi et al. 2020).
double hyab(const Vec3d& a, const Vec3d& b);

}  // namespace gs
