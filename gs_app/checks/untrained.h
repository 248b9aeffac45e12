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
  Gaussians& gaussians = model.gaussians;
  take_learned_arrays(gaussians, from.gaussians);
  gaussians.has_filter = from.gaussians.has_filter;
  for_each_stored_array(
      [](const char*, auto& to, const auto& array) {
        to.resize_discard(array.size());
        if (array.size())
          to.memory().upload(to.data(), array.data(), array.size() * sizeof(*array.data()));
      },
      gaussians, from.gaussians);
  clear_history(model);
  return model;
}

}  // namespace gs
