// SPDX-License-Identifier: Apache-2.0
// The optimizer's contract, and what it works on.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/math/mcmc.h"
#include "gs_core/random.h"

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

/// Gives the model `count` rows; the first ones are as they were, new ones undefined.
inline void resize_rows(TrainingModel& model, std::size_t count) {
  for (Gaussians* rows : {&model.gaussians, &model.first_moment, &model.second_moment})
    rows->resize(count);
  model.statistics.visits.resize(count);
  model.statistics.gradient_norm.resize(count);
}

/// Noise on the means in one step; it depends on seed, step and row alone, so that every backend and a resumed run draw
/// the same.
struct PositionNoise {
  float scale = 0;  // times the learning rate of the means; 0: none
  Random random{0, RandomStream::position_noise};
  int step = 0;

  GS_HD Vec3f normal(std::size_t row) const {
    const Vec4f draw = random.normal4(std::uint64_t(step), std::uint32_t(row));
    return {draw.x, draw.y, draw.z};
  }
};

class Optimizer {
 public:
  virtual ~Optimizer() = default;
  /// gradients += those of the regularizers, for every row.
  virtual void regularize(const TrainingModel& model, const Regularizers& regularizers,
                          Gaussians& gradients) = 0;
  /// One Adam update of every row, visible or not (dense semantics). Counts model.adam_steps up.
  virtual void step(TrainingModel& model, const Gaussians& gradients,
                    const LearningRates& rates) = 0;
  /// means += noise; `position_rate` is the learning rate of the means in this step.
  virtual void add_noise(TrainingModel& model, const PositionNoise& noise, float position_rate) = 0;
};

}  // namespace gs
