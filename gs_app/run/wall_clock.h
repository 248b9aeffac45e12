// SPDX-License-Identifier: Apache-2.0
// Where the time of a command goes.
#pragma once

#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace gs {

/// Parts of a command that follow each other without a gap, so that they add up to the time from its
/// begin to now.
class WallClock {
 public:
  using Clock = std::chrono::steady_clock;

  explicit WallClock(Clock::time_point begin) : last_(begin) {}

  /// Ends a part that began where the one before has ended.
  void end(const std::string& part) { end(part, since_last()); }
  /// The same for a part that took `seconds` of the time since then; the next one has the rest.
  void end(const std::string& part, double seconds) {
    parts_.emplace_back(part, seconds);
    last_ += std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  }
  /// The parts and their seconds, in order.
  const std::vector<std::pair<std::string, double>>& parts() const { return parts_; }

 private:
  double since_last() const { return std::chrono::duration<double>(Clock::now() - last_).count(); }

  Clock::time_point last_;
  std::vector<std::pair<std::string, double>> parts_;
};

/// When this process began, to a hundredth of a second; now where the system does not say.
WallClock::Clock::time_point process_begin();

}  // namespace gs
