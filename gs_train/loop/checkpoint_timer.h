// SPDX-License-Identifier: Apache-2.0
// When a checkpoint is due.
#pragma once

#include <algorithm>
#include <chrono>

namespace gs {

/// Follows train.checkpoint_every. N: every N steps. 0: once a minute, or less often where writing
/// would take more than 1 % of the time. -1: never. Call note_written() after each checkpoint.
class CheckpointTimer {
 public:
  using Clock = std::chrono::steady_clock;
  explicit CheckpointTimer(int every) : every_(every) {}

  /// Whether one is due after the steps (before, step].
  bool due(int before, int step) const {
    if (every_ > 0) return step / every_ != before / every_;
    return every_ == 0 && Clock::now() >= next_;
  }
  void note_written(Clock::time_point begin) {
    const Clock::time_point now = Clock::now();
    next_ = now + std::max<Clock::duration>(kInterval, kOneIn * (now - begin));
  }

 private:
  static constexpr std::chrono::seconds kInterval{60};  // so much work may be lost
  static constexpr int kOneIn = 100;  // at most 1 / 100 of the time is spent on checkpoints

  int every_;
  Clock::time_point next_ = Clock::now() + kInterval;
};

}  // namespace gs
