// SPDX-License-Identifier: Apache-2.0
#include "gs_app/observers/sight_observer.h"

#include <algorithm>
#include <iterator>

#include "gs_core/system/log.h"

namespace gs {
namespace {

constexpr int kStepsUntilSomethingIsSeen = 100;

bool is_nonzero(const FloatMoments& moments) { return moments.first != 0 || moments.second != 0; }

template <class Rows>
bool has_nonzero(const Rows& rows) {
  const auto values = rows.download();
  return std::any_of(values.begin(), values.end(), [](const auto& row) {
    return std::any_of(std::begin(row.number), std::end(row.number),
                       [](const auto& moments) { return is_nonzero(opened(moments)); });
  });
}

// A Gaussian that was seen has had gradients of its color or its mean. Regularizers act on neither.
bool has_seen_something(Trainer& trainer) {
  return std::visit(
      [](const auto& moments) { return has_nonzero(moments.sh0) || has_nonzero(moments.mean); },
      trainer.model().moments);
}

}  // namespace

void SightObserver::after_step(int step, Trainer& trainer) {
  const bool is_last = step == trainer.schedule().steps();  // its moments may be released
  if (has_looked_ || is_last || step < kStepsUntilSomethingIsSeen ||
      step % trainer.config().train.log_every != 0)
    return;
  has_looked_ = true;
  if (has_seen_something(trainer)) return;
  progress_.clear();
  log_warning(
      "step {}: no view has shown any Gaussian yet, so nothing is being learned; look at the "
      "scene with `gemsplat doctor`, and check its poses, render.near_plane and render.far_plane",
      step);
}

}  // namespace gs
