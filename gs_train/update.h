// SPDX-License-Identifier: Apache-2.0
// What one update of the parameters takes, stage 8.
#pragma once

#include "gs_core/math/density/mcmc.h"
#include "gs_core/math/random.h"
#include "gs_core/math/update/adam.h"
#include "gs_train/training_model.h"

namespace gs {

/// One learning rate per learned quantity, for one step. The position rate includes the scene's
/// extent.
template <class T>
using RateOf = float;
using LearningRates = GaussianArrays<RateOf>;

/// The Adam step of each learned quantity.
template <class T>
using AdamStepOf = AdamStep;
using AdamSteps = GaussianArrays<AdamStepOf>;
inline AdamSteps adam_steps(int t, const LearningRates& rates) {
  AdamSteps steps;
  steps.has_time = true;
  for_each_array([&](const char*, AdamStep& step, float rate) { step = adam_step(t, rate); }, steps,
                 rates);
  return steps;
}

/// One update of the parameters.
struct Update {
  LearningRates rates;
  AdamRule rule = {};
  float photometric_rate = 0;       // of the photometric model; 0: it rests
  float pose_rate = 0;              // of the poses; 0: they rest
  AdamRule photo_rule = {};         // of both
  std::uint64_t rounding_seed = 0;  // of HalfMoments (MomentRounding)
};

/// Noise on the means in one step. It depends on seed, step and row alone, so that every backend
/// and a resumed run draw the same numbers.
struct PositionNoise {
  float scale = 0;  // times the learning rate of the means; 0: none
  Random random{0, RandomStream::position_noise};
  int step = 0;

  GS_HD Vec3f normal(std::size_t row) const {
    const Vec4f draw = random.normal4(std::uint64_t(step), std::uint32_t(row));
    return {draw.x, draw.y, draw.z};
  }
};

}  // namespace gs
