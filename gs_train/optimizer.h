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

class Optimizer {
 public:
  virtual ~Optimizer() = default;
  /// One Adam update of every row, visible or not (dense semantics). Counts model.adam_steps up.
  virtual void step(TrainingModel& model, const Gaussians& gradients,
                    const LearningRates& rates) = 0;
};

}  // namespace gs
