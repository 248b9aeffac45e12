// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/check_sight.h"

#include <string>
#include <vector>

#include "gs_core/error.h"
#include "gs_core/geometry/scene_sight.h"
#include "gs_core/system/log.h"

namespace gs {

void check_sight(Trainer& trainer) {
  std::vector<Camera> cameras;
  for (const View& view : trainer.scene().train_views) cameras.push_back(view.camera);
  const std::vector<Vec3f> means = trainer.model().gaussians.mean.download();
  const DepthLimits limits{trainer.settings().near_plane, trainer.settings().far_plane};
  const SceneSight sight = scene_sight(cameras, {means.data(), means.size()}, limits);
  const std::string& model = trainer.config().model.start_from;
  if (sight.is_blind() && !model.empty())
    throw Error("training cannot start from " + model +
                ", because every picture would be empty; start from a model of this scene: " +
                text_of(sight, limits));
  if (sight.is_blind())
    throw Error("training cannot start, because every picture would be empty: " +
                text_of(sight, limits));
  if (sight.is_doubtful()) log_warning("{}", text_of(sight, limits));
}

}  // namespace gs
