// SPDX-License-Identifier: Apache-2.0
// Ctrl-C and SIGTERM while training: the trainer ends after the step at hand, so that the work can
// be saved.
#pragma once

#include "gs_core/system/processes/signals.h"
#include "gs_train/loop/trainer.h"

namespace gs {

/// While it lives, the first signal stops the trainer. One at a time.
class StopOnSignal {
 public:
  explicit StopOnSignal(Trainer& trainer) { trainer_ = &trainer; }
  ~StopOnSignal() { trainer_ = nullptr; }
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

 private:
  // set after the handlers, reset before they go
  static inline Trainer* volatile trainer_ = nullptr;
  SignalHandlers handlers_{[](int) {
    if (Trainer* const trainer = trainer_) trainer->stop();
  }};
};

}  // namespace gs
