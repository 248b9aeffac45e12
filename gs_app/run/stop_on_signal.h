// SPDX-License-Identifier: Apache-2.0
// Ctrl-C and SIGTERM as a wish: the trainer ends after the step at hand, so that the work can be
// saved; a server ends.
#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>

#include "gs_core/error.h"
#include "gs_train/trainer.h"

namespace gs {

/// While it lives, the first SIGINT and the first SIGTERM call `handler`; a second one of the same
/// kind ends the program at once.
class SignalHandlers {
 public:
  explicit SignalHandlers(void (*handler)(int)) {
    struct sigaction action {};
    action.sa_handler = handler;
    action.sa_flags = int(SA_RESETHAND) | SA_RESTART;
    sigaction(SIGINT, &action, &old_interrupt_);
    sigaction(SIGTERM, &action, &old_terminate_);
  }
  ~SignalHandlers() {
    sigaction(SIGINT, &old_interrupt_, nullptr);
    sigaction(SIGTERM, &old_terminate_, nullptr);
  }
  SignalHandlers(const SignalHandlers&) = delete;
  SignalHandlers& operator=(const SignalHandlers&) = delete;

 private:
  struct sigaction old_interrupt_ {
  }, old_terminate_{};
};

/// While it lives, the first signal stops the trainer. One at a time.
class StopOnSignal {
 public:
  explicit StopOnSignal(Trainer& trainer) { trainer_ = &trainer; }
  ~StopOnSignal() { trainer_ = nullptr; }
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

 private:
  static inline Trainer* volatile trainer_ = nullptr;
  SignalHandlers handlers_{[](int) {
    if (Trainer* const trainer = trainer_) trainer->stop();  // it is named after the handlers and forgotten before them
  }};
};

/// Waits for a signal that comes at any time while it lives. One at a time.
class SignalWait {
 public:
  /// Throws Error where the system has no more files.
  SignalWait() {
    if (::pipe2(pipe_, O_CLOEXEC) != 0)
      throw Error("cannot wait for signals: too many files are open; end other programs");
  }
  ~SignalWait() {
    ::close(pipe_[0]);
    ::close(pipe_[1]);
  }
  SignalWait(const SignalWait&) = delete;
  SignalWait& operator=(const SignalWait&) = delete;

  void wait() {
    char byte = 0;
    while (::read(pipe_[0], &byte, 1) < 0 && errno == EINTR) {
    }
  }

 private:
  static inline int pipe_[2];
  SignalHandlers handlers_{[](int) {
    const int error = errno;
    [[maybe_unused]] const auto written = ::write(pipe_[1], "", 1);
    errno = error;
  }};
};

}  // namespace gs
