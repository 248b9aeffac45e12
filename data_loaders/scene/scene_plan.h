// SPDX-License-Identifier: Apache-2.0
// A scene before its photos are decoded: folders, cameras, files and points, from the COLMAP model
// (or transforms.json) and the photos' headers.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "data_loaders/refine/solve_exposures.h"
#include "data_loaders/scene/depth/depth_agreement.h"
#include "data_loaders/scene/load_scene.h"
#include "data_loaders/scene/plan_views.h"
#include "data_loaders/scene/scene_files.h"
#include "data_loaders/scene/shown_points.h"

namespace gs {

struct ScenePlan {
  std::vector<ViewPlan> views;  // sorted by name
  std::vector<bool> is_test;    // (views)
  std::vector<ScenePoint> points;
  std::vector<std::vector<SeenPoint>> seen;  // (views)   empty without dataset.exposure
  std::vector<bool> is_used;                 // (views)   empty without dataset.photo_list
  ShownPoints shown;                         // (views)   empty unless asked for
  Vec3d world_offset{0.0, 0.0, 0.0};
  std::optional<CameraRefinement> refinement;
  std::size_t time_count = 0;
  DepthSource depth;
};

/// Reads the model and plans every view. Logs what was refined, and what the depth maps hold.
/// Throws Error that names the file or the setting.
ScenePlan plan_scene(const DatasetConfig& dataset, const LoadProgress& progress,
                     bool asks_who_shows = false);

/// The same, with the depth maps as dataset.depth_kind says, whether they fit or not.
ScenePlan plan_unsettled_scene(const DatasetConfig& dataset, const LoadProgress& progress,
                               bool asks_who_shows);

/// Leaves out the views that are not used, and the points that no other view shows.
void leave_out_unused(ScenePlan& plan);

/// The exposures of the photos that are used; `fit` has those of all.
ExposureFit chosen_exposures(ExposureFit fit, const std::vector<bool>& is_used);

std::vector<Camera> cameras_of(const std::vector<ViewPlan>& views);

}  // namespace gs
