// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "gs_train/training_model.h"

namespace gs {

/// A training model of these Gaussians in another memory, as before its first step.
inline TrainingModel untrained(const GaussianModel& from, Memory& memory) {
  TrainingModel model(memory);
  model.gaussians = copy_to(memory, from);
  clear_history(model);
  return model;
}

}  // namespace gs
