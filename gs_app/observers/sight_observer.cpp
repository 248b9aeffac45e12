// SPDX-License-Identifier: Apache-2.0
#include "gs_app/observers/sight_observer.h"

#include <algorithm>
#include <vector>

#include "gs_core/log.h"

namespace gs {
namespace {

constexpr int kStepsUntilSomethingIsSeen = 100;

bool has_nonzero(const Buffer<Vec3f>& rows) {
  const std::vector<Vec3f> values = rows.download();
  return std::any_of(values.begin(), values.end(),
                     [](const Vec3f& v) { return v.x != 0 || v.y != 0 || v.z != 0; });
}

// A Gaussian that was seen has had gradients of its color or its mean. Regularizers act on neither.
bool has_seen_something(Trainer& trainer) {
  const Gaussians& moments = trainer.model().second_moment;
  return has_nonzero(moments.sh0) || has_nonzero(moments.mean);
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
      "step {}: no view has shown any Gaussian so far, so nothing is being learned; look at the "
      "scene with `gemsplat doctor`, and check its poses, render.near_plane and render.far_plane",
      step);
}

}  // namespace gs
