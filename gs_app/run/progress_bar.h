// SPDX-License-Identifier: Apache-2.0
// How far a long job is, on standard error: one line that is redrawn on a terminal, a line every tenth of
// the way elsewhere.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>

namespace gs {

/// Ask due(done) as often as you like, and draw() only when it says so: that keeps the figures shown, and
/// what they cost, out of the work. Call clear() before other lines are written, finish() at the end.
class ProgressBar {
 public:
  /// `enabled` false: nothing is ever due.
  ProgressBar(std::int64_t total, bool enabled);
  ~ProgressBar() { clear(); }

  bool due(std::int64_t done);
  /// Shows "done/total", what is given as `detail`, the rate in `unit` per second, and the time left.
  void draw(std::int64_t done, const std::string& detail, const std::string& unit);
  void clear();
  /// Completed units per second, over the last moments.
  double rate() const { return rate_; }

 private:
  using Clock = std::chrono::steady_clock;
  void measure(std::int64_t done);

  std::int64_t total_;
  bool enabled_, is_terminal_;
  bool line_is_drawn_ = false;
  Clock::time_point start_ = Clock::now(), last_time_ = start_;
  std::int64_t last_done_ = 0, next_tenth_ = 1;
  double rate_ = 0;
};

}  // namespace gs
