// SPDX-License-Identifier: Apache-2.0
// Stages 1 and 7 of cameras with a lens: where the map of a lens takes a point of its chart, with
// the first and second derivatives, all in closed form. data_loaders/lenses/lens_formulas.h has the
// same maps, by COLMAP's parameters, for undistorting.
#pragma once

#include "gs_core/lens.h"

namespace gs {

/// A function of one number with its first and second derivative.
template <class T>
struct Curve {
  T value, slope, curvature;
};

/// sum a_n t^n, n = 0, 1, ..., by Horner's rule.
template <class T>
GS_HD Curve<T> polynomial_at(const T* a, int count, const T& t) {
  Curve<T> f{T(0), T(0), T(0)};
  for (int n = count - 1; n >= 0; --n) {
    f.curvature = f.curvature * t + T(2) * f.slope;
    f.slope = f.slope * t + f.value;
    f.value = f.value * t + a[n];
  }
  return f;
}

/// atan(sqrt(e)) / sqrt(e), e >= 0. Below kSeriesLimit it is its series, because the derivatives
/// cancel most of their digits there: in single precision 8e-6 and 3e-4 of them are lost at half of
/// the limit's root, 4e-6 and 7e-5 at the limit.
///
///   sum (-e)^n / (2n + 1)
inline constexpr double kSeriesLimit = 0.09;  // of e = tan^2(angle): 16.7 degrees
template <class T>
GS_HD Curve<T> arctangent_ratio(const T& e) {
  using std::atan, std::sqrt;
  if (e < T(kSeriesLimit)) {
    constexpr int kTerms = 16;  // 1e-15 at the limit
    Curve<T> f{T(0), T(0), T(0)};
    for (int n = kTerms - 1; n >= 0; --n) {
      f.curvature = f.curvature * e + T(2) * f.slope;
      f.slope = f.slope * e + f.value;
      f.value = f.value * e + T((n % 2 ? -1.0 : 1.0) / (2 * n + 1));
    }
    return f;
  }
  const T r = sqrt(e), f = atan(r) / r, n = T(1) / (T(1) + e);
  const T slope = (n - f) / (T(2) * e);
  return {f, slope, -(n * n + T(3) * slope) / (T(2) * e)};
}

/// Maps that scale u do it by a function of t = |u|^2: lens_formulas.h has them.
///
///   polynomials   q = N / M,   q' = (N' - q M') / M,   q'' = (N'' - 2 q' M' - q M'') / M
///   fov           q = s f(s^2 t) / w with f of arctangent_ratio(), s = 2 tan(w / 2)
///   division      q = 2 / (1 + e),   e^2 = 1 - 4 k t,   q' = k q^2 / e,   q'' = 2 k q (q'/e + k q/e^3)
///   unified       q = 1 / (a e + 1 - a),   e^2 = b t + 1,
///                 q' = -a b q^2 / (2 e),   q'' = -a b q q' / e + a b^2 q^2 / (4 e^3)
template <class T>
GS_HD Curve<T> radial_scale(const LensCoefficients<T>& lens, const T& t) {
  using std::sqrt, std::tan;
  const T* k = lens.k;
  switch (lens.lens) {
    case Lens::none:
    case Lens::orthographic: break;
    case Lens::radial_tangential:
    case Lens::fisheye:
    case Lens::fisheye_rad_tan: {
      const T above[7] = {T(1), k[0], k[1], k[2], k[3], k[4], k[5]};
      const T below[4] = {T(1), lens.d[0], lens.d[1], lens.d[2]};
      const Curve<T> N = polynomial_at(above, 7, t), M = polynomial_at(below, 4, t);
      const T inverse = T(1) / M.value, q = N.value * inverse;
      const T slope = (N.slope - q * M.slope) * inverse;
      return {q, slope, (N.curvature - T(2) * slope * M.slope - q * M.curvature) * inverse};
    }
    case Lens::fov: {
      const T s = T(2) * tan(k[0] / T(2)), s2 = s * s;
      const Curve<T> f = arctangent_ratio(s2 * t);
      const T a = s / k[0];
      return {a * f.value, a * s2 * f.slope, a * s2 * s2 * f.curvature};
    }
    case Lens::division: {
      const T e = sqrt(T(1) - T(4) * k[0] * t), q = T(2) / (T(1) + e);
      const T slope = k[0] * q * q / e;
      return {q, slope, T(2) * k[0] * q * (slope / e + k[0] * q / (e * e * e))};
    }
    case Lens::unified: {
      const T a = k[0], b = k[1], e = sqrt(b * t + T(1)), q = T(1) / (a * e + T(1) - a);
      const T slope = -a * b * q * q / (T(2) * e);
      return {q, slope, -a * b * q * slope / e + a * b * b * q * q / (T(4) * e * e * e)};
    }
  }
  return {T(1), T(0), T(0)};
}

/// What a map does at a point u.
template <class T>
struct MapAt {
  Vec2<T> value;             // u'
  Vec2<T> row_x, row_y;      // D = du'/du, by rows
  Sym2<T> curve_x, curve_y;  // d^2 u'.x / du du, and that of u'.y
};

template <class T>
GS_HD Vec2<T> multiply(const Sym2<T>& S, const Vec2<T>& v) {
  return {S.xx * v.x + S.xy * v.y, S.xy * v.x + S.yy * v.y};
}

/// u q(|u|^2):   D_ij = q I_ij + 2 q' u_i u_j,
///               H_ijk = 2 q' (I_ij u_k + I_ik u_j + I_jk u_i) + 4 q'' u_i u_j u_k
template <class T>
GS_HD MapAt<T> radial_at(const LensCoefficients<T>& lens, const Vec2<T>& u) {
  const Curve<T> q = radial_scale(lens, u.x * u.x + u.y * u.y);
  const T a = T(2) * q.slope, b = T(4) * q.curvature;
  const T xx = u.x * u.x, xy = u.x * u.y, yy = u.y * u.y;
  const T cross_x = u.y * (a + b * xx), cross_y = u.x * (a + b * yy);  // H_xxy, H_xyy
  return {q.value * u,
          {q.value + a * xx, a * xy},
          {a * xy, q.value + a * yy},
          {u.x * (T(3) * a + b * xx), cross_x, cross_y},
          {cross_x, cross_y, u.y * (T(3) * a + b * yy)}};
}

/// What elements off the axis and tilted ones add (lens_formulas.h, decentering()), with
/// e = (s1 + 2 s2 t, s3 + 2 s4 t).
template <class T>
GS_HD MapAt<T> decentering_at(const LensCoefficients<T>& lens, const Vec2<T>& u) {
  const T p1 = lens.p[0], p2 = lens.p[1], *s = lens.s, x = u.x, y = u.y;
  const T t = x * x + y * y, ex = s[0] + T(2) * s[1] * t, ey = s[2] + T(2) * s[3] * t;
  const T shear = T(2) * (p1 * x + p2 * y), sx = T(8) * s[1], sy = T(8) * s[3];
  return {{T(2) * p1 * x * y + p2 * (t + T(2) * x * x) + t * (s[0] + t * s[1]),
           p1 * (t + T(2) * y * y) + T(2) * p2 * x * y + t * (s[2] + t * s[3])},
          {T(2) * p1 * y + T(6) * p2 * x + T(2) * x * ex, shear + T(2) * y * ex},
          {shear + T(2) * x * ey, T(6) * p1 * y + T(2) * p2 * x + T(2) * y * ey},
          {T(6) * p2 + T(2) * ex + sx * x * x, T(2) * p1 + sx * x * y,
           T(2) * p2 + T(2) * ex + sx * y * y},
          {T(2) * p1 + T(2) * ey + sy * x * x, T(2) * p2 + sy * x * y,
           T(6) * p1 + T(2) * ey + sy * y * y}};
}

template <class T>
GS_HD Sym2<T> sum_of(const Sym2<T>& a, const Sym2<T>& b) {
  return {a.xx + b.xx, a.xy + b.xy, a.yy + b.yy};
}

/// The map of a lens at u, a point of its chart.
///
/// Most models add decentering at u. That of RAD_TAN_THIN_PRISM_FISHEYE adds it at b = radial(u):
///   D = (I + D_dec(b)) D_rad,   H = H_dec[D_rad, D_rad] + (I + D_dec) H_rad
template <class T>
GS_HD MapAt<T> map_at(const LensCoefficients<T>& lens, const Vec2<T>& u) {
  MapAt<T> map = radial_at(lens, u);
  if (lens.lens == Lens::fov || lens.lens == Lens::division || lens.lens == Lens::unified)
    return map;
  if (lens.lens != Lens::fisheye_rad_tan) {
    const MapAt<T> by = decentering_at(lens, u);
    map.value += by.value;
    map.row_x += by.row_x, map.row_y += by.row_y;
    map.curve_x = sum_of(map.curve_x, by.curve_x);
    map.curve_y = sum_of(map.curve_y, by.curve_y);
    return map;
  }
  const MapAt<T> by = decentering_at(lens, map.value);
  const Vec2<T> column_x{map.row_x.x, map.row_y.x}, column_y{map.row_x.y, map.row_y.y};
  const auto chained = [&](const Sym2<T>& H, const Vec2<T>& row) -> Sym2<T> {
    const Vec2<T> Hx = multiply(H, column_x), Hy = multiply(H, column_y);
    const Sym2<T>&a = map.curve_x, &b = map.curve_y;
    return {inner(column_x, Hx) + row.x * a.xx + row.y * b.xx,
            inner(column_x, Hy) + row.x * a.xy + row.y * b.xy,
            inner(column_y, Hy) + row.x * a.yy + row.y * b.yy};
  };
  const Vec2<T> to_x{T(1) + by.row_x.x, by.row_x.y}, to_y{by.row_y.x, T(1) + by.row_y.y};
  return {map.value + by.value,
          {inner(to_x, column_x), inner(to_x, column_y)},
          {inner(to_y, column_x), inner(to_y, column_y)},
          chained(by.curve_x, to_x),
          chained(by.curve_y, to_y)};
}

}  // namespace gs
