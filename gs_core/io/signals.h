// SPDX-License-Identifier: Apache-2.0
// SIGINT (Ctrl-C) and SIGTERM, handled in one place. Each class works while it lives and then puts
// the handlers back that were there before.
#pragma once

#include <csignal>

namespace gs {

/// While it lives, SIGINT and SIGTERM call `handler`, which may only do what POSIX allows in a
/// signal handler.
class SignalHandlers {
 public:
  enum class Calls {
    first,  // the first SIGINT and the first SIGTERM; a second one ends the program at once
    all
  };
  explicit SignalHandlers(void (*handler)(int), Calls calls = Calls::first);
  ~SignalHandlers();
  SignalHandlers(const SignalHandlers&) = delete;
  SignalHandlers& operator=(const SignalHandlers&) = delete;

 private:
  struct sigaction old_interrupt_, old_terminate_;
};

/// While it lives, signals are counted and do nothing else. One at a time.
class SignalCount {
 public:
  int value() const { return count_; }

 private:
  static inline volatile std::sig_atomic_t count_ = 0;
  struct Start {
    Start() { count_ = 0; }
  } start_;  // before the handlers, which count
  SignalHandlers handlers_{[](int) { count_ = count_ + 1; }, SignalHandlers::Calls::all};
};

/// Waits for a signal, which may come at any time while it lives. One at a time.
class SignalWait {
 public:
  /// Throws Error if too many files are open.
  SignalWait();
  ~SignalWait();
  SignalWait(const SignalWait&) = delete;
  SignalWait& operator=(const SignalWait&) = delete;

  void wait();

 private:
  struct Pipe {
    Pipe();
    ~Pipe();
  };
  static void wake(int);

  static inline int ends_[2];  // of the pipe: to read, to write
  Pipe pipe_;                  // before the handlers, which write into it
  SignalHandlers handlers_{wake};
};

}  // namespace gs
