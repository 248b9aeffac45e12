// SPDX-License-Identifier: Apache-2.0
// A training model in its state before the first step.
#pragma once

#include "gs_train/training_model.h"

namespace gs {

/// A training model of these Gaussians in `memory`, with zero moments and statistics.
inline TrainingModel untrained(const GaussianModel& from, Memory& memory) {
  TrainingModel model(memory);
  model.gaussians = copy_to(memory, from);
  clear_history(model);
  return model;
}

}  // namespace gs
