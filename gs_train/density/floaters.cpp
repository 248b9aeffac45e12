// SPDX-License-Identifier: Apache-2.0
#include "gs_train/density/floaters.h"

#include <algorithm>

#include "gs_core/math/render/activations.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr float kFloaterLogit = -30;  // logit of an opacity of 1e-13, which a prune removes

}  // namespace

FloaterFinder::FloaterFinder(const Scene& scene, float clearance, int witnesses)
    : clearance_(clearance), witnesses_(std::max(witnesses, 1)) {
  if (!(clearance > 0)) return;
  views_.resize(scene.train_views.size());
  parallel_for(views_.size(), 1, [&](std::size_t v) {
    views_[v] = PointDepths(scene.train_views[v].camera, scene.points);
  });
}

std::vector<std::uint8_t> FloaterFinder::marks(const std::vector<Vec3f>& means) const {
  std::vector<std::uint8_t> marks(means.size());
  parallel_for(means.size(), 1024, [&](std::size_t i) {
    bool is_seen_through = false;
    int witnesses = 0;
    for (const PointDepths& view : views_) {
      const Sight sight = view.sight_of(means[i], clearance_);
      is_seen_through |= sight == Sight::through;
      witnesses += sight == Sight::witness;
      if (witnesses >= witnesses_) return;
    }
    marks[i] = is_seen_through;
  });
  return marks;
}

std::size_t remove_floaters(TrainingModel& model, RowOps& rows, const FloaterFinder& finder) {
  const std::vector<std::uint8_t> marks = finder.marks(model.gaussians.mean.download());
  const auto count = std::size_t(std::count(marks.begin(), marks.end(), 1));
  if (count == 0) return 0;
  const Buffer<float>& opacities = model.gaussians.logit_opacity;
  std::vector<float> logits = opacities.download();
  for (std::size_t i = 0; i < logits.size(); ++i)
    if (marks[i]) logits[i] = kFloaterLogit;
  opacities.memory().upload(opacities.data(), logits.data(), logits.size() * sizeof(float));
  rows.prune(model, sigmoid(kFloaterLogit / 2));
  return count;
}

}  // namespace gs
