// SPDX-License-Identifier: Apache-2.0
#include "gs_eval/flip/flip_color.h"

#include <cmath>

namespace gs {
namespace {

struct Matrix {
  Vec3d rows[3];

  Vec3d operator*(const Vec3d& v) const {
    return {inner(rows[0], v), inner(rows[1], v), inner(rows[2], v)};
  }
};

// XYZ of linear sRGB; the white of D65 is the sum of each row.
constexpr Matrix kXyzFromRgb = {
    {{10135552.0 / 24577794, 8788810.0 / 24577794, 4435075.0 / 24577794},
     {2613072.0 / 12288897, 8788810.0 / 12288897, 887015.0 / 12288897},
     {1425312.0 / 73733382, 8788810.0 / 73733382, 70074185.0 / 73733382}}};

double sum(const Vec3d& v) { return v.x + v.y + v.z; }

// The columns of the inverse of a matrix with rows a, b, c are b x c, c x a, a x b over det.
Matrix inverse(const Matrix& m) {
  const auto cross = [](const Vec3d& u, const Vec3d& v) {
    return Vec3d{u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
  };
  const Vec3d& a = m.rows[0];
  const Vec3d bc = cross(m.rows[1], m.rows[2]), ca = cross(m.rows[2], a), ab = cross(a, m.rows[1]);
  const double s = 1 / inner(a, bc);
  return {{{bc.x * s, ca.x * s, ab.x * s},
           {bc.y * s, ca.y * s, ab.y * s},
           {bc.z * s, ca.z * s, ab.z * s}}};
}

// XYZ over that of white, of linear sRGB, and back.
Matrix relative_xyz_from_rgb() {
  Matrix m = kXyzFromRgb;
  for (Vec3d& row : m.rows) row = row * (1 / sum(row));
  return m;
}
const Matrix kRelativeFromRgb = relative_xyz_from_rgb();
const Matrix kRgbFromRelative = inverse(kRelativeFromRgb);

// CIE 1976: the cube root, with a straight line near black.
double lab_curve(double t) {
  constexpr double kDelta = 6.0 / 29;
  return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3 * kDelta * kDelta) + 4.0 / 29;
}

}  // namespace

double linear_from_srgb(double value) {
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

Vec3d ycxcz_from_linear(const Vec3d& linear_rgb) {
  const Vec3d n = kRelativeFromRgb * linear_rgb;
  return {116 * n.y - 16, 500 * (n.x - n.y), 200 * (n.y - n.z)};
}

Vec3d linear_from_ycxcz(const Vec3d& ycxcz) {
  const double y = (ycxcz.x + 16) / 116;
  return kRgbFromRelative * Vec3d{y + ycxcz.y / 500, y, y - ycxcz.z / 200};
}

Vec3d hunt_lab_from_linear(const Vec3d& linear_rgb) {
  const Vec3d n = kRelativeFromRgb * linear_rgb;
  const double x = lab_curve(n.x), y = lab_curve(n.y), z = lab_curve(n.z);
  const double lightness = 116 * y - 16;
  return {lightness, 0.01 * lightness * 500 * (x - y), 0.01 * lightness * 200 * (y - z)};
}

double hyab(const Vec3d& a, const Vec3d& b) {
  return std::abs(a.x - b.x) + std::sqrt((a.y - b.y) * (a.y - b.y) + (a.z - b.z) * (a.z - b.z));
}

}  // namespace gs
