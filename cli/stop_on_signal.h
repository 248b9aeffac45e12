// SPDX-License-Identifier: Apache-2.0
// Ctrl-C and SIGTERM as a wish: the trainer ends after the step at hand, so that the work can be saved.
#pragma once

#include <csignal>

#include "gs_train/trainer.h"

namespace gs {

/// While it lives, the first SIGINT or SIGTERM stops the trainer; a second one of the same kind ends the
/// program at once.
/// One at a time.
class StopOnSignal {
 public:
  explicit StopOnSignal(Trainer& trainer) {
    trainer_ = &trainer;
    struct sigaction action {};
    action.sa_handler = [](int) { trainer_->stop(); };
    action.sa_flags = int(SA_RESETHAND) | SA_RESTART;
    sigaction(SIGINT, &action, &old_interrupt_);
    sigaction(SIGTERM, &action, &old_terminate_);
  }
  ~StopOnSignal() {
    sigaction(SIGINT, &old_interrupt_, nullptr);
    sigaction(SIGTERM, &old_terminate_, nullptr);
    trainer_ = nullptr;
  }
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

 private:
  static inline Trainer* trainer_ = nullptr;
  struct sigaction old_interrupt_ {
  }, old_terminate_{};
};

}  // namespace gs
