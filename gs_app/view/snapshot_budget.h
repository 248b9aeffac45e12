// SPDX-License-Identifier: Apache-2.0
// Decides when a run copies its model for the viewer: only while a page is polling, and in at most
// 1% of the run's time.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <limits>

namespace gs {

/// Example: a copy that takes 0.2 s is followed by a pause of 20 s. note_poll() may be called from
/// any thread, the other functions only from the thread that trains.
class SnapshotBudget {
 public:
  // A page counts as watching for this long after each poll.
  static constexpr double kWatchSeconds = 5;
  static constexpr double kLeastPauseRatio = 100;  // pause after a copy, in units of its duration

  using Clock = std::function<double()>;  // seconds since an arbitrary moment

  explicit SnapshotBudget(Clock clock = steady_seconds) : clock_(std::move(clock)) {}

  /// A page has polled the run's state.
  void note_poll() { last_poll_ = clock_(); }

  /// Whether a page is watching and the pause after the last copy is over.
  bool allows_copy() const {
    const double now = clock_();
    return now - last_poll_ <= kWatchSeconds && now >= next_copy_;
  }

  /// Calls copy(), measures it, and begins the pause.
  template <class F>
  void spend(F&& copy) {
    const double begin = clock_();
    copy();
    const double end = clock_();
    next_copy_ = end + kLeastPauseRatio * (end - begin);
  }

  static double steady_seconds() {
    using Steady = std::chrono::steady_clock;
    return std::chrono::duration<double>(Steady::now().time_since_epoch()).count();
  }

 private:
  Clock clock_;
  std::atomic<double> last_poll_{-std::numeric_limits<double>::infinity()};
  double next_copy_ = -std::numeric_limits<double>::infinity();
};

}  // namespace gs
