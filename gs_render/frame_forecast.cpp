// SPDX-License-Identifier: Apache-2.0
#include "gs_render/frame_forecast.h"

#include <algorithm>
#include <limits>

namespace gs {
namespace {

constexpr std::size_t kMostKinds = 8;
// A jump between two frames, relative to the last one, after which frames are counted again. A
// wait for the count takes a few percent of a frame, and a second attempt takes a whole one.
constexpr double kJump = 1.0 / 8;
constexpr double kMarginOfChange = 2;      // times the last change
constexpr double kLeastMargin = 1.0 / 64;  // of the last count
constexpr double kFewInstances = 4096;     // of margin; they cost nothing
// CUB counts in int.
constexpr double kMostCapacity = std::numeric_limits<std::int32_t>::max();

}  // namespace

std::uint32_t FrameForecast::capacity_for(const FrameKind& kind) const {
  const auto seen = std::find_if(seen_.begin(), seen_.end(),
                                 [&](const Seen& other) { return other.kind == kind; });
  if (seen == seen_.end() || !seen->has_two) return 0;
  const double last = seen->last;
  const double change =
      std::max(last, double(seen->before_last)) - std::min(last, double(seen->before_last));
  if (change > std::max(kJump * last, kFewInstances)) return 0;
  const double margin = std::max({kMarginOfChange * change, kLeastMargin * last, kFewInstances});
  return std::uint32_t(std::min(last + margin, kMostCapacity));
}

void FrameForecast::note(const FrameKind& kind, std::uint32_t instances) {
  const auto seen = std::find_if(seen_.begin(), seen_.end(),
                                 [&](const Seen& other) { return other.kind == kind; });
  Seen now{kind, 0, instances, false};
  if (seen != seen_.end()) {
    now.before_last = seen->last;
    now.has_two = true;
    seen_.erase(seen);
  }
  seen_.push_front(now);
  if (seen_.size() > kMostKinds) seen_.pop_back();
}

}  // namespace gs
