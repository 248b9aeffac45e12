// SPDX-License-Identifier: Apache-2.0
// Stage 5: structural similarity at one pixel of one channel, from the local moments of both
// pictures.
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/types.h"

namespace gs {

/// Half of the separable 11-tap Gaussian window of sigma 1.5, normalized to sum 1:
/// kSsimWindow[|offset|]. Wang et al. 2004; the picture is zero outside, and weights are not
/// renormalized at its border.
inline constexpr float kSsimWindow[kSsimRadius + 1] = {0.2660117149f, 0.2130055279f, 0.1093606874f,
                                                       0.0360007733f, 0.0075987582f, 0.0010283801f};

/// Windowed means of x, y, x^2, y^2 and xy around a pixel; x the rendered picture, y the photo.
template <class T>
struct WindowMeans {
  T x, y, xx, yy, xy;
};

/// SSIM = (2 mx my + C1)(2 sxy + C2) / ((mx^2 + my^2 + C1)(sxx + syy + C2))   Wang et al. 2004, Eq. 13
template <class T>
GS_HD T ssim_index(const WindowMeans<T>& m) {
  const T A = m.x * m.x + m.y * m.y + T(kSsimC1);
  const T B = (m.xx - m.x * m.x) + (m.yy - m.y * m.y) + T(kSsimC2);
  const T C = T(2) * m.x * m.y + T(kSsimC1);
  const T D = T(2) * (m.xy - m.x * m.y) + T(kSsimC2);
  return C * D / (A * B);
}
/// Derivatives of ssim_index() by the moments that the rendered picture moves: x, xx and xy.
template <class T>
struct SsimGradient {
  T x, xx, xy;
};
template <class T>
GS_HD SsimGradient<T> ssim_index_vjp(const WindowMeans<T>& m, const T& dL_dssim) {
  const T A = m.x * m.x + m.y * m.y + T(kSsimC1);
  const T B = (m.xx - m.x * m.x) + (m.yy - m.y * m.y) + T(kSsimC2);
  const T C = T(2) * m.x * m.y + T(kSsimC1);
  const T D = T(2) * (m.xy - m.x * m.y) + T(kSsimC2);
  const T scale = dL_dssim / (A * B);
  const T ssim = C * D / (A * B);
  return {T(2) * scale * (m.y * (D - C) - m.x * ssim * (B - A)), -scale * C * D / B,
          T(2) * scale * C};
}

}  // namespace gs
