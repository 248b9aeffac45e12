// SPDX-License-Identifier: Apache-2.0
// When a checkpoint is due.
#pragma once

#include <algorithm>
#include <chrono>

namespace gs {

/// As train.checkpoint_every says: every N steps; or, for 0, once a minute and at most 1 % of the time; or, for -1,
/// never by itself. Tell it of each one that was written.
class CheckpointTimer {
 public:
  using Clock = std::chrono::steady_clock;
  explicit CheckpointTimer(int every) : every_(every) {}

  bool due(int step) const {
    if (every_ > 0) return step % every_ == 0;
    return every_ == 0 && Clock::now() >= next_;
  }
  void note_written(Clock::time_point begin) {
    const Clock::time_point now = Clock::now();
    next_ = now + std::max<Clock::duration>(kInterval, kOneIn * (now - begin));
  }

 private:
  static constexpr std::chrono::seconds kInterval{60};  // as much work may be lost
  static constexpr int kOneIn = 100;                    // of the time at most

  int every_;
  Clock::time_point next_ = Clock::now() + kInterval;
};

}  // namespace gs
