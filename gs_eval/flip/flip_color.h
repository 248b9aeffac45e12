// SPDX-License-Identifier: Apache-2.0
// The color spaces of FLIP and its distance between colors (Andersson et al. 2020). White is that of
// D65. Everything is inline, for loops over the pixels of a row.
#pragma once

#include <cmath>

#include "gs_core/types.h"
#include "gs_eval/flip/power.h"

namespace gs {

/// A value of display sRGB as linear light, both in [0, 1] (IEC 61966-2-1).
inline double linear_from_srgb(double value) {
  const double curved = power_of((value + 0.055) * (1 / 1.055), 2.4);
  return value <= 0.04045 ? value * (1 / 12.92) : curved;
}

/// CIE 1976: the cube root, with a straight line near black.
inline double lab_curve(double t) {
  constexpr double kDelta = 6.0 / 29;
  const double root = power_of(t, 1.0 / 3);
  return t > kDelta * kDelta * kDelta ? root : t * (1 / (3 * kDelta * kDelta)) + 4.0 / 29;
}

/// Distance of two colors of hunt_lab(): |dL| + sqrt(da^2 + db^2), "HyAB" (Abasi et al. 2020).
inline double hyab(const Vec3d& a, const Vec3d& b) {
  return std::abs(a.x - b.x) + std::sqrt((a.y - b.y) * (a.y - b.y) + (a.z - b.z) * (a.z - b.z));
}

/// From linear sRGB to the spaces that FLIP works in, and back.
class FlipColors {
 public:
  /// The opponent space in which FLIP filters: achromatic Y, red-green Cx, blue-yellow Cz.
  Vec3d ycxcz_from_linear(const Vec3d& linear_rgb) const {
    const Vec3d n = relative_from_rgb_ * linear_rgb;
    return {116 * n.y - 16, 500 * (n.x - n.y), 200 * (n.y - n.z)};
  }
  /// The inverse. Values outside of [0, 1] are colors that no display shows.
  Vec3d linear_from_ycxcz(const Vec3d& ycxcz) const {
    const double y = (ycxcz.x + 16) * (1.0 / 116);
    return rgb_from_relative_ * Vec3d{y + ycxcz.y * (1.0 / 500), y, y - ycxcz.z * (1.0 / 200)};
  }
  /// CIELab with a and b scaled by lightness, after Hunt: dark colors look less colorful.
  Vec3d hunt_lab(const Vec3d& linear_rgb) const {
    const Vec3d n = relative_from_rgb_ * linear_rgb;
    const double x = lab_curve(n.x), y = lab_curve(n.y), z = lab_curve(n.z);
    const double lightness = 116 * y - 16;
    return {lightness, 0.01 * lightness * 500 * (x - y), 0.01 * lightness * 200 * (y - z)};
  }

 private:
  struct Matrix {
    Vec3d rows[3];

    Vec3d operator*(const Vec3d& v) const {
      return {inner(rows[0], v), inner(rows[1], v), inner(rows[2], v)};
    }
  };

  // XYZ of linear sRGB, each over that of white, which is the sum of a row.
  static Matrix relative_xyz_from_rgb() {
    Matrix m = {{{10135552.0 / 24577794, 8788810.0 / 24577794, 4435075.0 / 24577794},
                 {2613072.0 / 12288897, 8788810.0 / 12288897, 887015.0 / 12288897},
                 {1425312.0 / 73733382, 8788810.0 / 73733382, 70074185.0 / 73733382}}};
    for (Vec3d& row : m.rows) row = row * (1 / (row.x + row.y + row.z));
    return m;
  }
  // The columns of the inverse of a matrix with rows a, b, c are b x c, c x a, a x b over det.
  static Matrix inverse(const Matrix& m) {
    const auto cross = [](const Vec3d& u, const Vec3d& v) {
      return Vec3d{u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
    };
    const Vec3d& a = m.rows[0];
    const Vec3d bc = cross(m.rows[1], m.rows[2]), ca = cross(m.rows[2], a),
                ab = cross(a, m.rows[1]);
    const double s = 1 / inner(a, bc);
    return {{{bc.x * s, ca.x * s, ab.x * s},
             {bc.y * s, ca.y * s, ab.y * s},
             {bc.z * s, ca.z * s, ab.z * s}}};
  }

  Matrix relative_from_rgb_ = relative_xyz_from_rgb();
  Matrix rgb_from_relative_ = inverse(relative_from_rgb_);
};

}  // namespace gs
