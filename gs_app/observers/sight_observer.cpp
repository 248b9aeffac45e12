// SPDX-License-Identifier: Apache-2.0
#include "gs_app/observers/sight_observer.h"

#include <algorithm>
#include <vector>

#include "gs_core/log.h"

namespace gs {
namespace {

constexpr int kStepsUntilSomethingIsSeen = 100;

bool has_nonzero(float number) { return number != 0; }
bool has_nonzero(const Vec3f& v) {
  return has_nonzero(v.x) || has_nonzero(v.y) || has_nonzero(v.z);
}
bool has_nonzero(const CodedRow<Vec3f>& row) {
  return std::any_of(std::begin(row.number), std::end(row.number),
                     [](TinyCode code) { return code.bits != 0; });
}
template <class T>
bool has_nonzero(const Buffer<T>& rows) {
  const std::vector<T> values = rows.download();
  return std::any_of(values.begin(), values.end(), [](const T& row) { return has_nonzero(row); });
}

// A Gaussian that was seen has had gradients of its color or its mean. Regularizers act on neither.
bool has_seen_something(Trainer& trainer) {
  bool result = false;
  for_each_moment(
      [&](const auto& moments) {
        result = result || has_nonzero(moments.sh0) || has_nonzero(moments.mean);
      },
      trainer.model());
  return result;
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
