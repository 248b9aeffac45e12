// SPDX-License-Identifier: Apache-2.0
// The clock of stages on the host.
#pragma once

#include <chrono>
#include <mutex>
#include <vector>

#include "gs_render/stage_time.h"

namespace gs {

/// Times the scalar stages while it is on. The process has one clock, since its stages share the
/// cores.
class StageClock {
 public:
  /// On: discards earlier times and starts to measure. Off: stops and keeps the times.
  void set_on(bool on);
  bool is_on() const { return is_on_; }
  void add(const char* stage, float milliseconds);
  /// In the order of first use.
  const std::vector<StageTime>& times() const { return times_; }

 private:
  bool is_on_ = false;
  std::mutex adding_;
  std::vector<StageTime> times_;
};

StageClock& host_stage_clock();

/// One run of a scalar stage, from here to the end of the block.
class HostStage {
 public:
  explicit HostStage(const char* stage);
  ~HostStage();
  HostStage(const HostStage&) = delete;
  HostStage& operator=(const HostStage&) = delete;

 private:
  using Clock = std::chrono::steady_clock;
  const char* stage_;
  Clock::time_point begin_;
};

}  // namespace gs
