// SPDX-License-Identifier: Apache-2.0
// The signals that ask the program to end, handled in one place: SIGINT (Ctrl-C), SIGTERM, and
// SIGHUP (the terminal was closed). Each class works while it lives and then puts the handlers back
// that were there before. A SIGHUP that is ignored, as under nohup, stays ignored.
#pragma once

#include <array>
#include <atomic>
#include <csignal>
#include <cstdint>
#include <optional>

namespace gs {

/// Lets a write beyond the largest file that is allowed (ulimit -f) fail as one on a full disk does,
/// instead of ending the program.
inline void ignore_file_size_signal() { std::signal(SIGXFSZ, SIG_IGN); }

inline constexpr std::array<int, 3> kStopSignals = {SIGINT, SIGTERM, SIGHUP};

/// While it lives, the stop signals call `handler`, which may only do what POSIX allows in a signal
/// handler. After the first signal, those that follow within a second are passed over, and every
/// SIGHUP: a terminal that closes sends two, and `timeout` sends SIGTERM twice, and neither is a
/// second wish.
class SignalHandlers {
 public:
  enum class Calls {
    first,  // a second signal ends the program at once
    all
  };
  explicit SignalHandlers(void (*handler)(int), Calls calls = Calls::first);
  ~SignalHandlers();
  /// Whether one lives: a signal then asks the work at hand to end.
  static bool are_set() { return current_ != nullptr; }
  SignalHandlers(const SignalHandlers&) = delete;
  SignalHandlers& operator=(const SignalHandlers&) = delete;

 private:
  static void dispatch(int signal);
  void receive(int signal);

  static inline std::atomic<SignalHandlers*> current_ = nullptr;
  void (*const handler_)(int);
  const Calls calls_;
  std::atomic<std::int64_t> first_ = 0;  // ms on the monotonic clock; 0: none yet
  SignalHandlers* const before_;
  std::array<struct sigaction, kStopSignals.size()> old_;
};

/// While it lives, the first signal writes a line to standard error and then ends the program as it
/// would have without this. One at a time.
class LastWords {
 public:
  /// `line` ends in a line end, and outlives this.
  explicit LastWords(const char* line) {
    line_ = line;
    if (may_end_program) handlers_.emplace(say);
  }

  /// False in a program that is not ours, such as an interpreter: its own handlers then stay.
  static inline bool may_end_program = true;

 private:
  static void say(int signal);

  static inline std::atomic<const char*> line_ = nullptr;
  std::optional<SignalHandlers> handlers_;
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
