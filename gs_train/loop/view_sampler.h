// SPDX-License-Identifier: Apache-2.0
// Which view each step trains on.
#pragma once

#include <vector>

#include "gs_core/math/random.h"

namespace gs {

/// Gives every view once per epoch; each epoch has its own shuffled order. The view of a step
/// depends on the seed and the step alone, so that a resumed run sees the same views.
class ViewSampler {
 public:
  ViewSampler(std::size_t views, std::uint64_t seed);
  /// Index of the view of step 1, 2, ...
  std::size_t view_of(int step);
  /// The order of all views in the epoch of the last call of view_of().
  const std::vector<std::size_t>& order() const { return order_; }

 private:
  void shuffle(std::uint64_t epoch);

  Random random_;
  std::vector<std::size_t> order_;
  std::uint64_t epoch_;
};

}  // namespace gs
