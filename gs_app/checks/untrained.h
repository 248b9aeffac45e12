// SPDX-License-Identifier: Apache-2.0
// A training model in its state before the first step.
#pragma once

#include "gs_core/config/config_words.h"
#include "gs_train/training_model.h"

namespace gs {

/// A training model of these Gaussians in `memory`, with moments and statistics of zero.
inline TrainingModel untrained(const GaussianModel& from, Memory& memory,
                               MomentStorage moments = MomentStorage::floats) {
  TrainingModel model(memory);
  model.store_moments_as(moments);
  model.gaussians = copy_of(from.gaussians, memory);
  clear_history(model);
  return model;
}

}  // namespace gs
