// SPDX-License-Identifier: Apache-2.0
// Stages 8 and 9 under the MCMC strategy, for one Gaussian at a time. Gaussians are samples that
// walk through the scene (stochastic gradient Langevin dynamics). This file has the regularizers of
// opacity and scale, the noise on the mean, and the parameters of copies that share one Gaussian.
// Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte Carlo"
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/math/density/density.h"
#include "gs_core/math/render/activations.h"
#include "gs_core/math/render/covariance.h"
#include "gs_core/math/render/rotation.h"
#include "gs_core/types.h"

namespace gs {

/// Weights of means over all Gaussians in the loss; 0: none. Those of Gaussians in space and time are
/// in spacetime_regularizer.h.
struct Regularizers {
  float opacity = 0;
  float scale = 0;       // 1 / world units
  float time_scale = 0;  // of 1 / the scale in time; durations
  float velocity = 0;    // of its square; (durations / world units)^2

  bool any() const { return opacity != 0 || scale != 0 || time_scale != 0 || velocity != 0; }
  /// The weight of each single number if there are this many Gaussians.
  Regularizers of_each(std::size_t gaussians) const {
    const double count = gaussians > 0 ? double(gaussians) : 1.0;
    return {float(opacity / count), float(scale / (3 * count)), float(time_scale / count),
            float(velocity / count)};
  }
};

/// The loss that one Gaussian adds, so that Gaussians that no view needs fade and shrink.
/// Kheradmand et al. 2024
///
///   w_o o + w_s (s_x + s_y + s_z),   w of_each()
template <class T>
GS_HD T regularizer(const Vec3<T>& log_scale, const T& logit_opacity, const Regularizers& of_each) {
  using std::exp;
  return T(of_each.opacity) * sigmoid(logit_opacity) +
         T(of_each.scale) * (exp(log_scale.x) + exp(log_scale.y) + exp(log_scale.z));
}
template <class T>
struct RegularizerGradient {
  Vec3<T> log_scale;
  T logit_opacity;
};
/// Gradients of regularizer(), of dL/d(regularizer) = 1.
template <class T>
GS_HD RegularizerGradient<T> regularizer_vjp(const Vec3<T>& log_scale, const T& logit_opacity,
                                             const Regularizers& of_each) {
  using std::exp;
  const T weight = T(of_each.scale);
  return {{weight * exp(log_scale.x), weight * exp(log_scale.y), weight * exp(log_scale.z)},
          sigmoid_vjp(sigmoid(logit_opacity), T(of_each.opacity))};
}

/// The noise on a mean after a step. It follows the Gaussian's own covariance, so that the Gaussian
/// explores its neighborhood, and is strong only while the Gaussian is faint.
///                                             Kheradmand et al. 2024, k and o_0 from its code
///
///   rate sigmoid(-k (o - o_0)) Sigma n,   k = 100, o_0 = 0.005
///
/// normal  three independent standard normal numbers
/// rate    1 / world units: the learning rate of the means times the scale of the noise
/// world units
template <class T>
GS_HD Vec3<T> position_noise(const Sym3<T>& sigma, const T& logit_opacity, const Vec3<T>& normal,
                             const T& rate) {
  const T gate = sigmoid(T(-kNoiseSteepness) * (sigmoid(logit_opacity) - T(kNoiseOpacity)));
  return rate * gate * multiply(sigma, normal);
}
/// The noise of a Gaussian, from its stored parameters. Zero for a Gaussian without a rotation.
template <class T>
GS_HD Vec3<T> position_noise(const Vec3<T>& log_scale, const Quat<T>& rotation,
                             const T& logit_opacity, const Vec3<T>& normal, const T& rate) {
  if (is_degenerate(rotation)) return Vec3<T>(T(0));
  return position_noise(covariance(rotation_matrix(rotation), variance(log_scale)), logit_opacity,
                        normal, rate);
}

/// A Gaussian's weight in the draw of sources for copies: its opacity in units of 2^-24. It is 0
/// for a dead Gaussian (opacity up to `dead_opacity`), which cannot be drawn. Weights are integers,
/// so that sums do not depend on their order, and are computed in double, so that the CPU and the
/// GPU get the same ones.
GS_HD std::uint32_t draw_weight(float logit_opacity, float dead_opacity) {
  const double opacity = sigmoid(double(logit_opacity));
  return opacity > double(dead_opacity) ? std::uint32_t(opacity * 0x1p24 + 0.5) : 0;
}

/// The opacity of each of `copies` equal Gaussians in one place that together have the opacity of
/// one.
///
///   1 - (1 - o_new)^N = o                                                    Kheradmand et al. 2024
template <class T>
GS_HD T shared_opacity(const T& opacity, int copies) {
  using std::pow;
  return T(1) - pow(T(1) - opacity, T(1) / T(copies));
}

/// The factor for the scales of such copies that keeps the blended light along a line through them.
///
///   o / sum_{i=1..N} sum_{k=0..i-1} (i-1 over k) (-1)^k o_new^(k+1) / sqrt(k+1)       Kheradmand et al. 2024
/// and since sum_{i=k+1..N} (i-1 over k) = (N over k+1), in one sum:
///   o / sum_{k=1..N} (N over k) (-1)^(k-1) o_new^k / sqrt(k)
///
/// The terms alternate and are up to (1 + o_new)^N: call it in double.
template <class T>
GS_HD T shared_scale(const T& opacity, const T& new_opacity, int copies) {
  using std::sqrt;
  T sum = T(0), term = T(-1);  // (N over k) (-o_new)^k, with the other sign
  for (int k = 1; k <= copies; ++k) {
    term *= -new_opacity * T(copies - k + 1) / T(k);
    sum += term / sqrt(T(k));
  }
  return opacity / sum;
}

/// The parameters that change when a Gaussian is shared among copies.
struct SharedGaussian {
  float logit_opacity;
  Vec3f log_scale;
};
/// The parameters of each of `copies` Gaussians, at most kMostCopies, that replace one. Opacities
/// are kept between `least_opacity` and the largest value that a logit can represent.
GS_HD SharedGaussian shared_gaussian(float logit_opacity, const Vec3f& log_scale, int copies,
                                     float least_opacity) {
  using std::log;
  const int number = min_of(copies, kMostCopies);
  const double most = 1.0 - double(kMinShareTransmittance);
  const double opacity = min_of(sigmoid(double(logit_opacity)), most);
  const double share = shared_opacity(opacity, number);
  const float change = float(log(shared_scale(opacity, share, number)));
  return {float(logit(clamp_to(share, double(least_opacity), most))), log_scale + Vec3f(change)};
}

}  // namespace gs
