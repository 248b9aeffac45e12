// SPDX-License-Identifier: Apache-2.0
// Stage 8: Adam, one scalar parameter.
#pragma once

#include "gs_core/math/constants.h"
#include "gs_core/math/update/adam_moments.h"
#include "gs_core/types.h"

namespace gs {

/// How fast an update forgets earlier gradients.
struct AdamRule {
  float beta1 = float(kAdamBeta1), one_minus_beta1 = float(1.0 - kAdamBeta1);
  float beta2 = float(kAdamBeta2), one_minus_beta2 = float(1.0 - kAdamBeta2);
  float epsilon = kAdamEpsilon;
  int steps = 1;  // of t, for which the update stands
};

/// One update by the mean gradient of `photos` photos stands for as many updates by one photo each:
/// betas to that power, epsilon / sqrt(photos), and learning rates * batch_rate(photos).
/// Malladi et al. 2022 (square root rule of Adam).
inline AdamRule batch_rule(int photos) {
  const double beta1 = std::pow(kAdamBeta1, photos), beta2 = std::pow(kAdamBeta2, photos);
  return {float(beta1),
          float(1.0 - beta1),
          float(beta2),
          float(1.0 - beta2),
          float(kAdamEpsilon / std::sqrt(double(photos))),
          photos};
}
inline float batch_rate(int photos) { return float(std::sqrt(double(photos))); }

/// The values that all parameters of one quantity share in one step, including the bias
/// corrections.
struct AdamStep {
  float rate;                // learning rate / (1 - beta1^t)
  float inverse_sqrt_bias2;  // 1 / sqrt(1 - beta2^t)
};

/// Step t = 1, 2, ... at the given learning rate. t counts for the whole model: a Gaussian that
/// joins late starts with zero moments at the common t, as in the original.
inline AdamStep adam_step(int t, float learning_rate) {
  return {float(learning_rate / (1.0 - std::pow(kAdamBeta1, t))),
          float(1.0 / std::sqrt(1.0 - std::pow(kAdamBeta2, t)))};
}

/// m = b1 m + (1-b1) g;  v = b2 v + (1-b2) g^2;  p -= rate m / (sqrt(v) / sqrt(1-b2^t) + eps)
/// Kingma & Ba 2015, Alg. 1, with bias corrections in AdamStep.
///
/// `stored` is FloatMoments or HalfMoments. The parameter moves by the moments before they are
/// rounded by `random` (moment_rounding.h).
template <class Stored>
GS_HD void adam_update(float& parameter, Stored& stored, float gradient, const AdamStep& step,
                       const AdamRule& rule = AdamRule(), std::uint32_t random = 0) {
  using std::sqrt;
  FloatMoments moments = opened(stored);
  float &m = moments.first, &v = moments.second;
  m = rule.beta1 * m + rule.one_minus_beta1 * gradient;
  v = rule.beta2 * v + rule.one_minus_beta2 * (gradient * gradient);
  parameter -= step.rate * m / (sqrt(v) * step.inverse_sqrt_bias2 + rule.epsilon);
  store(stored, moments, random);
}

}  // namespace gs
