// SPDX-License-Identifier: Apache-2.0
// Notices a run that trains on empty pictures.
#pragma once

#include "gs_app/observers/train_observers.h"

namespace gs {

/// Warns once if no view has shown any Gaussian in the first 100 steps, so that nothing is learned.
/// It looks after a step of train.log_every, for which MetricsObserver has waited for the device;
/// add it after that one.
class SightObserver final : public Observer {
 public:
  explicit SightObserver(ProgressObserver& progress) : progress_(progress) {}
  void after_step(int step, Trainer& trainer) override;

 private:
  ProgressObserver& progress_;
  bool has_looked_ = false;
};

}  // namespace gs
