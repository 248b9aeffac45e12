// SPDX-License-Identifier: Apache-2.0
// Stages 4 and 6: one fragment, which is a splat at one pixel: its exponent, its alpha, its
// compositing, and the gradients of these, front to back.
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/math/render/render_rules.h"
#include "gs_core/types.h"

#ifndef __CUDA_ARCH__
#include <bit>
#endif

namespace gs {

/// Exponent of a splat at offset d = pixel - mean: E = -1/2 d^T Q d, never above 0.
template <class T>
GS_HD T fragment_exponent(const Sym2<T>& conic, const T& dx, const T& dy) {
  const T half = T(-0.5) * multiply_add(conic.xx * dx, dx, conic.yy * dy * dy);
  return min_of(multiply_add(-conic.xy * dx, dy, half), T(0));
}
template <class T>
struct ExponentGradient {
  Sym2<T> conic;
  Vec2<T> mean2d;
};
/// Gradients of fragment_exponent(); by the mean, which enters d with a minus sign.
template <class T>
GS_HD ExponentGradient<T> fragment_exponent_vjp(const Sym2<T>& conic, const T& dx, const T& dy,
                                                const T& dL_dE) {
  return {{T(-0.5) * dx * dx * dL_dE, T(-0.5) * dx * dy * dL_dE, T(-0.5) * dy * dy * dL_dE},
          {(conic.xx * dx + conic.xy * dy) * dL_dE, (conic.xy * dx + conic.yy * dy) * dL_dE}};
}

/// The conic in factors: (log2 e / 2) Q = L L^T, so that -log2(e) E = |u|^2 with u = L^T d. Unlike
/// those of Q, the terms of |u|^2 do not cancel, however long a needle is.
///
///   u_x = xx d_x + xy d_y,   u_y = yy d_y
template <class T>
struct ConicFactors {
  T xx, xy, yy;  // 1 / pixels
};
/// The factors of a splat's conic. `variance_y` is the yy of the image-plane covariance, in
/// pixels^2; computed from the conic alone, the factor yy would be a difference that cancels.
template <class T>
GS_HD ConicFactors<T> conic_factors(const Sym2<T>& conic, const T& variance_y) {
  using std::sqrt;
  const T scale = sqrt(T(kLog2E) / T(2));
  const T xx = scale * sqrt(conic.xx);
  return {xx, conic.xy / conic.xx * xx, scale / sqrt(variance_y)};
}

/// The conic that belongs to the factors: Q = 2 ln 2 L L^T.
template <class T>
GS_HD Sym2<T> conic_of(const ConicFactors<T>& L) {
  const T scale = T(2 * kLn2);
  return {scale * L.xx * L.xx, scale * L.xx * L.xy, scale * (L.xy * L.xy + L.yy * L.yy)};
}

/// log2(alpha) of a splat as a polynomial of the pixel's position, so that many splats at many
/// pixels are one matrix product (GEMM-GS): alpha = 2^<coefficients, monomials>.
inline constexpr int kExponentTerms = 6;
template <class T>
struct ExponentTerms {
  T of[kExponentTerms];
};
/// The monomials of a pixel: 1, x, y, x^2, x y, y^2 of its offset from a reference point. About the
/// center of a tile of 16 pixels these are multiples of 1/4 up to 56.25, which half precision holds
/// exactly.
template <class T>
GS_HD ExponentTerms<T> pixel_monomials(const T& x, const T& y) {
  return {{T(1), x, y, x * x, x * y, y * y}};
}
/// The coefficients of a splat, including its opacity and log2(e). `mean` is its offset from the
/// same reference point. For a long needle, u_x is a small difference of two large products.
template <class T>
GS_HD ExponentTerms<T> exponent_coefficients(const ConicFactors<T>& L, const Vec2<T>& mean,
                                             const T& log2_opacity) {
  const T u_x = sum_of_products(L.xx, mean.x, L.xy, mean.y), u_y = L.yy * mean.y;
  return {{log2_opacity - u_x * u_x - u_y * u_y, T(2) * u_x * L.xx,
           T(2) * (u_x * L.xy + u_y * L.yy), -L.xx * L.xx, T(-2) * L.xx * L.xy,
           -(L.xy * L.xy + L.yy * L.yy)}};
}
template <class T>
GS_HD T inner(const ExponentTerms<T>& a, const ExponentTerms<T>& b) {
  T sum = a.of[0] * b.of[0];
  for (int k = 1; k < kExponentTerms; ++k) sum += a.of[k] * b.of[k];
  return sum;
}

/// exp(x) for the exponents of fragments, -80 <= x <= 0. For float, exp(x) = 2^n * 2^f with |f| <=
/// 1/2 and a polynomial for 2^f (Taylor series of e^{f ln 2}, relative error under 3e-7). It has no
/// branches, so that compilers can vectorize loops around it.
template <class T>
GS_HD T exp_fragment(const T& x) {
  using std::exp;
  return exp(x);
}
#ifndef __CUDA_ARCH__
inline float exp_fragment(const float& x) {
  const float t = x * float(kLog2E);
  // 1.5 * 2^23: rounds to the nearest integer
  const float rounded = (t + 12582912.0f) - 12582912.0f;
  const float f = x - rounded * 0.693359375f + rounded * 2.12194440e-4f;  // ln 2 in two parts
  float p = 1.0f / 720.0f;
  p = multiply_add(p, f, 1.0f / 120.0f);
  p = multiply_add(p, f, 1.0f / 24.0f);
  p = multiply_add(p, f, 1.0f / 6.0f);
  p = multiply_add(p, f, 0.5f);
  p = multiply_add(p, f, 1.0f);
  p = multiply_add(p, f, 1.0f);
  const std::int32_t exponent = std::int32_t(rounded);
  return p * std::bit_cast<float>((exponent + 127) << 23);
}
#endif

/// alpha = o exp(E), under the classic rule at most 0.99.   Kerbl et al. 2023, Sec. 4
template <BlendRule rule, class T>
GS_HD T fragment_alpha(const T& opacity, const T& gaussian) {
  const T alpha = opacity * gaussian;
  return rule == BlendRule::classic ? min_of(alpha, T(kMaxAlphaClassic)) : alpha;
}

template <class T>
struct AlphaGradient {
  T opacity, exponent;
};
/// Gradients of fragment_alpha() by the opacity and by the exponent E, gaussian = exp(E); zero
/// where clamped.
template <BlendRule rule, class T>
GS_HD AlphaGradient<T> fragment_alpha_vjp(const T& opacity, const T& gaussian, const T& dL_dalpha) {
  const T alpha = opacity * gaussian;
  const bool clamped = rule == BlendRule::classic && alpha > T(kMaxAlphaClassic);
  return {clamped ? T(0) : gaussian * dL_dalpha, clamped ? T(0) : alpha * dL_dalpha};
}

/// The state of one pixel while its fragments are blended from front to back.
template <class T>
struct PixelState {
  Vec3<T> color{T(0), T(0), T(0)};
  T transmittance{1};
};

/// True where the pixel takes no further fragment after this one was blended (faster_gs) or instead
/// of blending it (classic).
template <class T>
GS_HD bool is_opaque(const T& transmittance) {
  return transmittance < T(kMinTransmittance);
}

/// C += T alpha max(c, 0);  T *= 1 - alpha   Kerbl et al. 2023, Eq. 3
template <class T>
GS_HD void composite(PixelState<T>& pixel, const Vec3<T>& color, const T& alpha) {
  const T weight = pixel.transmittance * alpha;
  const Vec3<T> clamped{max_of(color.x, T(0)), max_of(color.y, T(0)), max_of(color.z, T(0))};
  pixel.color = pixel.color + weight * clamped;
  pixel.transmittance = pixel.transmittance * (T(1) - alpha);
}

/// The state of one pixel in the backward pass, which goes from front to back like the forward
/// pass, so that the transmittance is never divided (Faster-GS).
template <class T>
struct PixelBackwardState {
  // color that the fragments from here on still contribute, without background
  Vec3<T> color_behind{T(0), T(0), T(0)};
  T transmittance{1};  // before this fragment
  Vec3<T> dL_dcolor;   // of the pixel
  T background_term;   // -T_final * <dL/dcolor, background>
};
template <class T>
struct CompositeGradient {
  Vec3<T> color;
  T alpha;
};
/// Gradients of composite() by this fragment's color and alpha, including its effect on everything
/// behind:
///
///   dL/dc = T alpha g where c >= 0, with g = dL/d(pixel)
///   dL/dalpha = <T max(c, 0) - R / (1 - alpha), g> + ga / (1 - alpha)
/// with R the color behind this fragment. Advances the state past the fragment. Behind the pixel's
/// last fragment R is zero. `is_last` states this, because otherwise the rounding error of the
/// difference would be divided by 1 - alpha.
template <class T>
GS_HD CompositeGradient<T> composite_vjp(PixelBackwardState<T>& pixel, const Vec3<T>& color,
                                         const T& alpha, bool is_last = false) {
  const T weight = pixel.transmittance * alpha;
  const Vec3<T> clamped{max_of(color.x, T(0)), max_of(color.y, T(0)), max_of(color.z, T(0))};
  const Vec3<T>& g = pixel.dL_dcolor;
  pixel.color_behind = (is_last ? T(0) : T(1)) * (pixel.color_behind - weight * clamped);
  const T q = T(1) / max_of(T(1) - alpha, T(kMinOneMinusAlpha));
  const T dL_dalpha =
      inner(pixel.transmittance * clamped - q * pixel.color_behind, g) + q * pixel.background_term;
  pixel.transmittance = pixel.transmittance * (T(1) - alpha);
  return {{color.x >= T(0) ? weight * g.x : T(0), color.y >= T(0) ? weight * g.y : T(0),
           color.z >= T(0) ? weight * g.z : T(0)},
          dL_dalpha};
}

/// The depth behind a fragment, for the backward pass of sums of weights times depths Z.
template <class T>
struct DepthBackwardState {
  T behind;     // sum of weights times depths of this fragment and what is behind it
  T dL_ddepth;  // dL/dZ
};
template <class T>
struct DepthCompositeGradient {
  T alpha, depth;
};
/// Gradients of Z = sum T alpha z by this fragment's alpha and depth; call it before
/// composite_vjp(), with the transmittance before the fragment:
///
///   dL/dz = T alpha dL/dZ,   dL/dalpha = (T z - R / (1 - alpha)) dL/dZ
/// with R the sum behind this fragment. Advances the state past the fragment.
template <class T>
GS_HD DepthCompositeGradient<T> composite_depth_vjp(DepthBackwardState<T>& pixel,
                                                    const T& transmittance, const T& depth,
                                                    const T& alpha, bool is_last = false) {
  const T weight = transmittance * alpha;
  pixel.behind = (is_last ? T(0) : T(1)) * (pixel.behind - weight * depth);
  const T q = T(1) / max_of(T(1) - alpha, T(kMinOneMinusAlpha));
  return {(transmittance * depth - q * pixel.behind) * pixel.dL_ddepth, weight * pixel.dL_ddepth};
}

}  // namespace gs
