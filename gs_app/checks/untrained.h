// SPDX-License-Identifier: Apache-2.0
// A training model in its state before the first step.
#pragma once

#include "gs_core/config/config_words.h"
#include "gs_train/training_model.h"

namespace gs {

/// A training model of these Gaussians in `memory`, with zero moments in this form and statistics.
inline TrainingModel untrained(const GaussianModel& from, Memory& memory,
                               MomentForm moments = MomentForm::floats) {
  TrainingModel model(memory);
  model.has_codes = moments == MomentForm::compact;
  model.gaussians = copy_to(memory, from);
  clear_history(model);
  return model;
}

}  // namespace gs
