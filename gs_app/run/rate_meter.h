// SPDX-License-Identifier: Apache-2.0
// The speed of a long job, and the time that the rest of it takes.
#pragma once

#include <cstdint>

namespace gs {

/// Measures units per second over the last few seconds. What was done before the first note does
/// not count, so that a resumed run at step 5,000 starts with an unknown rate, and not with 5,000
/// steps in no time.
class RateMeter {
 public:
  /// `done` units are complete at the time `seconds`, on any clock that note() uses as well.
  RateMeter(std::int64_t done, double seconds) : last_done_(done), last_seconds_(seconds) {}

  /// `done` units are complete now. Fewer than before means that the job went back: the rate stays
  /// as it was.
  void note(std::int64_t done, double seconds);

  /// Units per second; 0 before the first measurement.
  double rate() const { return rate_; }

 private:
  std::int64_t last_done_;
  double last_seconds_;
  double rate_ = 0;
};

}  // namespace gs
