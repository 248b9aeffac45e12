// SPDX-License-Identifier: Apache-2.0
// Breakdowns of a run: when to look for them, and which view causes them.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace gs {

inline constexpr int kMostStrikes = 2;  // a view that breaks the model so often is skipped

/// Counts the breakdowns of a run. In a breakdown the loss is not a number, or many parameters are
/// not, or no Gaussian is left.
///
/// While all is well, the loss is checked only where it is logged, and the parameters at each
/// refinement and checkpoint. This costs nothing, but it finds a breakdown some steps after its
/// cause. After the first breakdown the trainer therefore goes back to its last checkpoint and
/// checks after each step ("watches") until it has passed the step of the discovery. The view of
/// the step that breaks the model then gets a strike, and is skipped after kMostStrikes.
///
/// For example, view 3 has a broken photo, and the log at step 100 shows a NaN. The run goes back
/// to step 90, sees that step 97 breaks the model, which trains on view 3, and goes back to 90
/// again. Another strike, and view 4 replaces view 3.
class RunGuard {
 public:
  explicit RunGuard(std::size_t views) : strikes_(views, 0) {}

  /// The number of strikes of each view, as checkpoints have it.
  const std::vector<int>& strikes() const { return strikes_; }
  void restore(const std::vector<int>& strikes);
  bool is_skipped(std::size_t view) const { return strikes_[view] >= kMostStrikes; }
  /// The view itself, or the next one that is not skipped.
  std::size_t instead_of(std::size_t view) const;

  /// True where the model must be checked after this step.
  bool is_watching(int step) const { return step <= watch_until_; }
  /// Counts a breakdown that was seen after `step`. With `blames_view`, the view of the step gets a
  /// strike if the steps were being watched. Returns a sentence for the user. Throws Error where
  /// training cannot go on.
  std::string note_breakdown(int step, const std::string& what, bool blames_view, std::size_t view,
                             const std::string& view_name);

 private:
  std::vector<int> strikes_;
  int watch_until_ = 0;  // the last step known to have broken the model
  int breakdowns_ = 0;
  int last_collapse_ = 0;  // the step after which no Gaussian was left
};

}  // namespace gs
