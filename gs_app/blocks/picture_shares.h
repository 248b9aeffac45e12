// SPDX-License-Identifier: Apache-2.0
// How much of each picture lies in which block, by a coarse model of the scene. Sparse points tell
// nothing of the sky and little of the background.
#pragma once

#include <vector>

#include "gs_app/blocks/partition.h"
#include "gs_app/run/open_model.h"
#include "gs_train/backend.h"
#include "gs_train/density/contribution.h"

namespace gs {

/// Renders the views of a scene with a model of it, in small pictures. The model's photos' frame is
/// that of the scene. The backend outlives it.
class PictureShares {
 public:
  PictureShares(OpenedModel opened, const Config& config, const SceneOutline& scene,
                Backend& backend);

  /// (blocks) the share of what is drawn in the view that lies in the block's region; regions
  /// overlap. All 0 where nothing is drawn.
  std::vector<double> operator()(std::size_t view, const std::vector<Block>& blocks);

  /// Says of each block that its run starts with the model.
  void start_from_model(std::vector<Block>& blocks);

 private:
  void find_inside(const std::vector<Block>& blocks);

  std::vector<Vec3d> places_;    // (rows)   of the means, in the photos' frame
  std::vector<Camera> cameras_;  // (views)
  Gaussians gaussians_;          // in the backend's memory
  ContributionMeter meter_;
  std::vector<std::vector<bool>> is_inside_;  // (blocks, rows)   made by the first call
};

}  // namespace gs
