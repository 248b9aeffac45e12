// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/rate_meter.h"

#include <cmath>

namespace gs {
namespace {

constexpr double kMemorySeconds = 2;  // after this time a measurement counts 1/e of what it did

}  // namespace

// An exponential mean over time: the weight of the past depends on the seconds between two notes,
// and not on their number. Notes that are minutes apart (a line every tenth of the way, in a log)
// are each a measurement of their own.
void RateMeter::note(std::int64_t done, double seconds) {
  const double elapsed = seconds - last_seconds_;
  if (done > last_done_ && elapsed <= 0) return;
  if (done > last_done_) {
    const double current = double(done - last_done_) / elapsed;
    const double past = rate_ > 0 ? std::exp(-elapsed / kMemorySeconds) : 0;
    rate_ = past * rate_ + (1 - past) * current;
  } else if (done == last_done_) {
    return;
  }
  last_done_ = done;
  last_seconds_ = seconds;
}

}  // namespace gs
