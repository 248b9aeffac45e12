// SPDX-License-Identifier: Apache-2.0
// When a run that somebody may be watching is looked at: never where nobody does, and for no more than a hundredth of the time.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <limits>

namespace gs {

/// watch() comes from any thread, all else from the one that looks.
class LookBudget {
 public:
  static constexpr double kWatchSeconds = 5;    // after a watcher's last question
  static constexpr double kLeastPauseRatio = 100;  // pause after a look, in terms of what it took

  using Clock = std::function<double()>;  // seconds since whenever

  explicit LookBudget(Clock clock = steady_seconds) : clock_(std::move(clock)) {}

  /// Somebody watches.
  void watch() { last_watch_ = clock_(); }

  bool may_look() const {
    const double now = clock_();
    return now - last_watch_ <= kWatchSeconds && now >= next_look_;
  }

  /// Calls f, and bars further looks for so long that it took no more than its share.
  template <class F>
  void look(F&& f) {
    const double begin = clock_();
    f();
    const double end = clock_();
    next_look_ = end + kLeastPauseRatio * (end - begin);
  }

  static double steady_seconds() {
    using Steady = std::chrono::steady_clock;
    return std::chrono::duration<double>(Steady::now().time_since_epoch()).count();
  }

 private:
  Clock clock_;
  std::atomic<double> last_watch_{-std::numeric_limits<double>::infinity()};
  double next_look_ = -std::numeric_limits<double>::infinity();
};

}  // namespace gs
