// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "gs_train/optimizer.h"

namespace gs {

/// A training model of these Gaussians in another memory, as before its first step.
inline TrainingModel untrained(const GaussianModel& from, Memory& memory) {
  TrainingModel model(memory);
  model.gaussians = copy_to(memory, from);
  for (Gaussians* moment : {&model.first_moment, &model.second_moment}) {
    moment->resize(model.count());
    moment->fill_zero();
  }
  for (Buffer<float>* statistic : {&model.statistics.visits, &model.statistics.gradient_norm}) {
    statistic->resize(model.count());
    statistic->fill_zero();
  }
  return model;
}

}  // namespace gs
