// SPDX-License-Identifier: Apache-2.0
// Whether a run still makes sense, and which view is to blame where it does not.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace gs {

inline constexpr int kMostStrikes = 2;  // of a view; then it is skipped

/// Keeps the books of a run that breaks down: its loss is not a number, or parameters are not, or no Gaussian is left.
/// Looking costs nothing while all is well: the loss is looked at where it is logged, the parameters at each refinement
/// and checkpoint. That says too late which step did it. So after the first breakdown the trainer goes back to its last
/// checkpoint and looks after each step until it has passed the place: then the view of the step that breaks the model
/// gets a strike, and is skipped after kMostStrikes of them.
class RunGuard {
 public:
  explicit RunGuard(std::size_t views) : strikes_(views, 0) {}

  /// Of each view; as checkpoints have them.
  const std::vector<int>& strikes() const { return strikes_; }
  void restore(const std::vector<int>& strikes);
  bool is_skipped(std::size_t view) const { return strikes_[view] >= kMostStrikes; }
  /// The view itself, or the next one that is not skipped.
  std::size_t instead_of(std::size_t view) const;

  /// Whether the model is to be looked at after this step.
  bool is_watching(int step) const { return step <= watch_until_; }
  /// A breakdown seen after `step`. `blames_view`: it was the step's view, if the step before was looked at.
  /// Says what follows from it in a sentence for the user. Throws Error where there is no way on.
  std::string note_breakdown(int step, const std::string& what, bool blames_view, std::size_t view,
                             const std::string& view_name);

 private:
  std::vector<int> strikes_;
  int watch_until_ = 0;     // the last step known to have broken the model
  int breakdowns_ = 0;
  int last_collapse_ = 0;   // the step
};

}  // namespace gs
