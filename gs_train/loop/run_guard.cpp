// SPDX-License-Identifier: Apache-2.0
#include "gs_train/loop/run_guard.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "gs_core/error.h"

namespace gs {
namespace {

constexpr int kMostBreakdowns = 20;  // in a run; more are not accidents

}  // namespace

void RunGuard::restore(const std::vector<int>& strikes) {
  GS_CHECK(strikes.size() == strikes_.size());
  strikes_ = strikes;
}

std::size_t RunGuard::instead_of(std::size_t view) const {
  for (std::size_t tried = 0; is_skipped(view) && tried < strikes_.size(); ++tried)
    view = (view + 1) % strikes_.size();
  return view;
}

std::string RunGuard::note_breakdown(int step, const std::string& what, bool blames_view,
                                     std::size_t view, const std::string& view_name) {
  const bool was_watching = is_watching(step);
  watch_until_ = std::max(watch_until_, step);
  const std::string event = fmt::format("after step {} {}", step, what);
  const bool is_repeated = !blames_view && last_collapse_ == step;
  if (!blames_view) last_collapse_ = step;
  if (++breakdowns_ > kMostBreakdowns || is_repeated)
    throw Error(event +
                ", again: training cannot go on; try lower learning rates (optimizer.*), a lower "
                "density.prune_opacity, or `gemsplat doctor` on the scene");
  if (!blames_view || !was_watching) return event;
  const int strike = ++strikes_[view];
  if (std::all_of(strikes_.begin(), strikes_.end(), [](int n) { return n >= kMostStrikes; }))
    throw Error(event + ": every view breaks the model; check the scene with `gemsplat doctor`");
  return event + fmt::format("; the view {} caused it {}", view_name,
                             strike < kMostStrikes ? "for the first time"
                                                   : "again and is skipped from now on");
}

}  // namespace gs
