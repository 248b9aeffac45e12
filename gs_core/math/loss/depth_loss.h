// SPDX-License-Identifier: Apache-2.0
// Stage 5 for photos with a depth map: the inverse depth of a pixel is compared with that of the
// map. docs/method/depth.md explains the choices.
//
// Of a pixel, blending knows Z = sum w z and A = sum w over its fragments of weight w and depth z.
// With the mask m of the pixel and t the inverse depth that the map stands for,
//
//   L = sum m A |q - t| / (n sum m),   q = A / Z,   n = sum m A t0 / sum m A
//
// over the pixels that the map knows. The mean n of the inverse depth makes L a relative error,
// which does not depend on the unit of the scene: t0 = t of a metric map, and q of all others,
// whose mean the fit below keeps. A pixel counts by its coverage A, since its depth says little
// where the Gaussians hardly cover it. These weights, n and the fit are constants in the gradient.
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/math/loss/depth_kind.h"
#include "gs_core/types.h"

namespace gs {

// ---- one pixel ---------------------------------------------------------------------------------

/// Whether a map knows anything of a pixel with this value. False for 0 and NaN.
GS_HD bool is_known_depth(float value) { return value > 0 && value - value == 0; }

/// Whether Gaussians cover a pixel of coverage A so much that it has a depth.
template <class T>
GS_HD bool has_depth(const T& A) {
  return A >= T(kMinAlpha);
}

/// The inverse depth that a pixel shows: q = A / Z.   1 / world units
template <class T>
GS_HD T inverse_depth(const T& Z, const T& A) {
  return A / Z;
}
template <class T>
struct DepthPixelGradient {
  T Z, A;
};
template <class T>
GS_HD DepthPixelGradient<T> inverse_depth_vjp(const T& Z, const T& A, const T& dL_dq) {
  return {-A / (Z * Z) * dL_dq, dL_dq / Z};
}

/// The share of one pixel in the loss: w |q - t|, where w and t are constants.
template <class T>
GS_HD T depth_error(const T& Z, const T& A, const T& t, const T& w) {
  const T difference = inverse_depth(Z, A) - t;
  return w * (difference > T(0) ? difference : -difference);
}
template <class T>
GS_HD DepthPixelGradient<T> depth_error_vjp(const T& Z, const T& A, const T& t, const T& w) {
  const T difference = inverse_depth(Z, A) - t;
  const T sign = T(difference > T(0)) - T(difference < T(0));
  return inverse_depth_vjp(Z, A, w * sign);
}

// ---- the fit of a map --------------------------------------------------------------------------

/// Scale and shift of one photo's map.
struct DepthFit {
  double scale = 1, shift = 0;
};

/// The inverse depth that a known value of a map stands for. Not above 0 where it stands for none.
///
///   metric, scaled   t = scale / v        scale is 1 for metric maps
///   relative         t = 1 / (scale v + shift)
///   inverse          t = scale v + shift
GS_HD double inverse_depth_of(DepthKind kind, const DepthFit& fit, double v) {
  if (kind == DepthKind::inverse) return fit.scale * v + fit.shift;
  if (kind != DepthKind::relative) return fit.scale / v;
  const double depth = fit.scale * v + fit.shift;
  return depth > 0 ? 1 / depth : 0;
}

/// What the fit of a photo is solved from: sums over its known pixels of weight w = m A.
struct DepthSums {
  double known = 0;               // sum m, also of pixels without coverage
  double weight = 0, level = 0;   // sum w, sum w t0
  double aa = 0, ab = 0, bb = 0;  // of the regression
  double aq = 0, bq = 0;
};
inline constexpr int kDepthSums = 8;
static_assert(sizeof(DepthSums) == kDepthSums * sizeof(double));

/// What the pixels of a photo are compared with.
struct DepthTarget {
  DepthFit fit;
  double level = 1;   // n, 1 / world units
  double factor = 0;  // w = factor m A; 0: the map teaches nothing
};

/// The fit of scale and shift minimizes sum w |q - t|, as the loss does: a line of least squares
/// would follow the few pixels that are far off, and pull all others along, step by step. Each of
/// so many rounds solves for least squares, with weights w / |q - t| by the round before.
inline constexpr int kDepthFitRounds = 5;
GS_HD int depth_fit_rounds(DepthKind kind) {
  return kind == DepthKind::metric ? 1 : kDepthFitRounds;
}

/// The share of one pixel in the sums, with m > 0 its mask, `v` the map's known value and `before`
/// the target of the round before (null in the first). With w = m A / |q - t|, the fit minimizes
/// sum w (q - scale a - shift b)^2:
///
///   scaled     a = 1 / v     b = 0
///   relative   a = q^2 v     b = q^2     an error of depth, in inverse depth to first order
///   inverse    a = v         b = 1
GS_HD DepthSums depth_sums_of_pixel(DepthKind kind, double v, double m, double Z, double A,
                                    const DepthTarget* before = nullptr) {
  constexpr double kLeastResidual = 1e-3;  // of n; nearer pixels count no more
  DepthSums sums;
  sums.known = m;
  if (!has_depth(A)) return sums;
  const double q = inverse_depth(Z, A);
  double a = 1 / v, b = 0;
  if (kind == DepthKind::relative) a = q * q * v, b = q * q;
  if (kind == DepthKind::inverse) a = v, b = 1;
  sums.weight = m * A;
  sums.level = sums.weight * (kind == DepthKind::metric ? a : q);
  double w = sums.weight;
  if (before && before->factor > 0) {
    const double residual = q - inverse_depth_of(kind, before->fit, v);
    const double size = residual > 0 ? residual : -residual, least = kLeastResidual * before->level;
    w /= size > least ? size : least;
  }
  sums.aa = w * a * a, sums.ab = w * a * b, sums.bb = w * b * b;
  sums.aq = w * a * q, sums.bq = w * b * q;
  return sums;
}

GS_HD void add_to(DepthSums& sums, const DepthSums& more) {
  sums.known += more.known;
  sums.weight += more.weight, sums.level += more.level;
  sums.aa += more.aa, sums.ab += more.ab, sums.bb += more.bb;
  sums.aq += more.aq, sums.bq += more.bq;
}

/// The target of a photo whose sums are known. The factor is 0 where no pixel is known and covered,
/// where the map is constant, and where a fitted scale is not above 0: such a map says the opposite
/// of what the model has, so that it was fitted to noise or is of another kind.
GS_HD DepthTarget depth_target(DepthKind kind, const DepthSums& sums, double weight) {
  // Of aa bb - ab^2, relative: below it only rounding is left of the map's variation.
  constexpr double kLeastVariation = 1e-9;
  DepthTarget target;
  if (!(sums.weight > 0) || !(sums.level > 0)) return target;
  if (kind == DepthKind::scaled) target.fit = {sums.aq / sums.aa, 0};
  if (kind == DepthKind::relative || kind == DepthKind::inverse) {
    const double determinant = sums.aa * sums.bb - sums.ab * sums.ab;
    if (!(determinant > kLeastVariation * sums.aa * sums.bb)) return target;
    target.fit = {(sums.aq * sums.bb - sums.bq * sums.ab) / determinant,
                  (sums.bq * sums.aa - sums.aq * sums.ab) / determinant};
  }
  target.level = sums.level / sums.weight;
  const double factor = weight / (target.level * sums.known);
  if (target.fit.scale > 0 && factor - factor == 0) target.factor = factor;
  return target;
}

/// The target of a photo after all rounds of the fit. `sums_of(before)` adds up the shares of its
/// pixels, with the target of the round before, which is null in the first.
template <class SumsOf>
DepthTarget fitted_depth_target(DepthKind kind, double weight, SumsOf&& sums_of) {
  DepthTarget target = depth_target(kind, sums_of(nullptr), weight);
  for (int round = 1; round < depth_fit_rounds(kind); ++round)
    target = depth_target(kind, sums_of(&target), weight);
  return target;
}

/// dL/dZ and dL/dA of one pixel of the photo; 0 where the map says nothing of it, or its depth is
/// not known. `loss`, unless null, receives its share.
GS_HD DepthPixelGradient<float> depth_pixel_vjp(DepthKind kind, const DepthTarget& target, float v,
                                                float m, float Z, float A, double* loss = nullptr) {
  if (loss) *loss = 0;
  if (!(target.factor > 0) || !(m > 0) || !is_known_depth(v) || !has_depth(A)) return {0, 0};
  const float t = float(inverse_depth_of(kind, target.fit, double(v)));
  if (!(t > 0)) return {0, 0};
  const float w = float(target.factor) * m * A;
  if (loss) *loss = double(depth_error(Z, A, t, w));
  return depth_error_vjp(Z, A, t, w);
}

/// The error of one pixel of a rendered depth D, relative to the depth 1 / t of the map:
/// |D - 1/t| t. It is 1 where nothing is drawn (D = 0).
GS_HD double relative_depth_error(double D, double t) {
  const double error = D * t - 1;
  return error > 0 ? error : -error;
}

}  // namespace gs
