// SPDX-License-Identifier: Apache-2.0
#include "gs_render/stage_clock.h"

#include <algorithm>

namespace gs {

void StageClock::set_on(bool on) {
  if (on) times_.clear();
  is_on_ = on;
}

void StageClock::add(const char* stage, float milliseconds) {
  const std::scoped_lock lock(adding_);
  auto found = std::find_if(times_.begin(), times_.end(),
                            [&](const StageTime& time) { return time.stage == stage; });
  if (found == times_.end()) found = times_.insert(times_.end(), {stage, {}});
  found->milliseconds.push_back(milliseconds);
}

StageClock& host_stage_clock() {
  static StageClock clock;
  return clock;
}

HostStage::HostStage(const char* stage)
    : stage_(host_stage_clock().is_on() ? stage : nullptr),
      begin_(stage_ ? Clock::now() : Clock::time_point{}) {}

HostStage::~HostStage() {
  if (!stage_) return;
  host_stage_clock().add(stage_,
                         std::chrono::duration<float, std::milli>(Clock::now() - begin_).count());
}

}  // namespace gs
