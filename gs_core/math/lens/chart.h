// SPDX-License-Identifier: Apache-2.0
// The angle chart of fisheyes: a ray is as far from the center as its angle from the axis. It has
// rays beside and behind the camera, all but the one straight back.
#pragma once

#include "gs_core/math/lens/lens_map.h"

namespace gs {

/// The chart at p, in camera coordinates; p is not on the rear half of the axis.
///
///   u = psi (x, y),   psi = theta / r,   r = |(x, y)|,   theta = atan2(r, z)      radians
template <class T>
struct AngleChart {
  Vec2<T> u;      // radians
  T psi;          // theta / r
  T kappa;        // (dpsi/dr) / r = (z / |p|^2 - psi) / r^2
  T kappa_slope;  // (dkappa/dr) / r = -(3 kappa + 2 z / |p|^4) / r^2
  T per_norm2;    // 1 / |p|^2 = -dpsi/dz
};
template <class T>
GS_HD AngleChart<T> angle_chart(const Vec3<T>& p) {
  using std::atan2, std::sqrt;
  const T r2 = p.x * p.x + p.y * p.y, n = T(1) / (r2 + p.z * p.z);
  AngleChart<T> chart;
  chart.per_norm2 = n;
  if (p.z > T(0) && r2 < T(kSeriesLimit) * p.z * p.z) {
    const T i = T(1) / p.z, i2 = i * i;
    const Curve<T> f = arctangent_ratio(r2 * i2);
    chart.psi = f.value * i;
    chart.kappa = T(2) * f.slope * i * i2;
    chart.kappa_slope = T(4) * f.curvature * i * i2 * i2;
  } else {
    const T r = sqrt(r2);
    chart.psi = atan2(r, p.z) / r;
    chart.kappa = (p.z * n - chart.psi) / r2;
    chart.kappa_slope = -(T(3) * chart.kappa + T(2) * p.z * n * n) / r2;
  }
  chart.u = {chart.psi * p.x, chart.psi * p.y};
  return chart;
}

/// du/dp = psi [I | 0] + (x, y)^t k^T,   k = dpsi/dp = (kappa x, kappa y, -1 / |p|^2).
template <class T>
GS_HD Mat23<T> jacobian(const AngleChart<T>& chart, const Vec3<T>& p) {
  const Vec3<T> k{chart.kappa * p.x, chart.kappa * p.y, -chart.per_norm2};
  return {{chart.psi + p.x * k.x, p.x * k.y, p.x * k.z},
          {p.y * k.x, chart.psi + p.y * k.y, p.y * k.z}};
}
/// dL/dp of jacobian(), with Q = dL/d(du/dp).
template <class T>
GS_HD Vec3<T> jacobian_vjp(const AngleChart<T>& chart, const Vec3<T>& p, const Mat23<T>& Q) {
  const T n = chart.per_norm2;
  const Vec3<T> k{chart.kappa * p.x, chart.kappa * p.y, -n};
  const Vec3<T> q = p.x * Q.row0 + p.y * Q.row1;  // dL/dk
  const T by_kappa = q.x * p.x + q.y * p.y;
  Vec3<T> dL_dp = (Q.row0.x + Q.row1.y) * k;  // through psi
  dL_dp += Vec3<T>(inner(Q.row0, k), inner(Q.row1, k), T(0));
  dL_dp += chart.kappa * Vec3<T>(q.x, q.y, T(0));
  dL_dp += by_kappa * Vec3<T>(chart.kappa_slope * p.x, chart.kappa_slope * p.y, T(2) * n * n);
  return dL_dp + (T(2) * q.z * n * n) * p;
}

}  // namespace gs
