// SPDX-License-Identifier: Apache-2.0
// The optimizer's contract, and what it works on.
#pragma once

#include "gs_core/gaussians.h"

namespace gs {

/// One learning rate per learned quantity, for one step. The position rate includes the scene's extent.
template <class T>
using RateOf = float;
using LearningRates = GaussianArrays<RateOf>;

/// What density control looks at, gathered over the steps since the last refinement.
struct DensityStatistics {
  Buffer<float> visits;         // (N) steps in which the Gaussian was visible
  Buffer<float> gradient_norm;  // (N) sum of |(W/2, H/2) * dL/dmean2d| over those steps

  explicit DensityStatistics(Memory& memory = host_memory())
      : visits(memory), gradient_norm(memory) {}
};

/// Everything that training changes: parameters, both Adam moments, statistics.
struct TrainingModel {
  Gaussians gaussians, first_moment, second_moment;
  DensityStatistics statistics;
  int adam_steps = 0;  // updates since the start; new Gaussians join in the middle, as in the original

  explicit TrainingModel(Memory& memory = host_memory())
      : gaussians(memory), first_moment(memory), second_moment(memory), statistics(memory) {}
  std::size_t count() const { return gaussians.count(); }
};

/// Gives a model whose Gaussians are set the moments and statistics of before its first step: zero.
inline void clear_history(TrainingModel& model) {
  for (Gaussians* moment : {&model.first_moment, &model.second_moment}) {
    moment->resize(model.count());
    moment->fill_zero();
  }
  for (Buffer<float>* statistic : {&model.statistics.visits, &model.statistics.gradient_norm}) {
    statistic->resize(model.count());
    statistic->fill_zero();
  }
  model.adam_steps = 0;
}

/// A copy of everything, in another memory.
inline TrainingModel copy_to(Memory& memory, const TrainingModel& from) {
  TrainingModel model(memory);
  const auto copy = [](const char*, auto& to, const auto& array) { to.upload(array.download()); };
  for_each_array(copy, model.gaussians, from.gaussians);
  for_each_array(copy, model.first_moment, from.first_moment);
  for_each_array(copy, model.second_moment, from.second_moment);
  copy("visits", model.statistics.visits, from.statistics.visits);
  copy("gradient_norm", model.statistics.gradient_norm, from.statistics.gradient_norm);
  model.adam_steps = from.adam_steps;
  return model;
}

class Optimizer {
 public:
  virtual ~Optimizer() = default;
  /// One Adam update of every row, visible or not (dense semantics). Counts model.adam_steps up.
  virtual void step(TrainingModel& model, const Gaussians& gradients,
                    const LearningRates& rates) = 0;
};

}  // namespace gs
