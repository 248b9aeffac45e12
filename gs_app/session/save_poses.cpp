// SPDX-License-Identifier: Apache-2.0
#include "gs_app/session/save_poses.h"

#include <algorithm>
#include <map>

#include "data_loaders/cameras/camera_file.h"
#include "data_loaders/colmap/colmap_write.h"
#include "data_loaders/colmap/world_offset.h"
#include "data_loaders/refine/refine_cameras.h"
#include "data_loaders/scene/scene_model.h"
#include "gs_app/run/pose_file.h"
#include "gs_core/math/render/quaternion.h"
#include "gs_core/system/log.h"
#include "gs_train/poses/poses.h"

namespace gs {
namespace {

// cameras.json needs names and cameras; the photos stay where they are.
Scene scene_with(const Scene& scene, const std::vector<Camera>& train_cameras) {
  Scene cameras;
  cameras.world_offset = scene.world_offset;
  for (std::size_t i = 0; i < train_cameras.size(); ++i)
    cameras.train_views.push_back({scene.train_views[i].name, train_cameras[i], {}});
  for (const View& view : scene.test_views)
    cameras.test_views.push_back({view.name, view.camera, {}});
  return cameras;
}

void set_poses(const Scene& scene, const std::vector<Camera>& refined, ColmapModel& model) {
  std::map<std::string, const Camera*> camera_of;
  for (std::size_t i = 0; i < refined.size(); ++i)
    camera_of[scene.train_views[i].name] = &refined[i];
  for (ColmapImage& image : model.images) {
    const auto found = camera_of.find(image.name);
    if (found == camera_of.end()) continue;
    const auto camera = camera_as<double>(*found->second);
    image.cam_from_world_rotation = quaternion_of(camera.cam_from_world_rotation);
    image.cam_from_world_translation = camera.cam_from_world_translation;
  }
}

}  // namespace

void save_poses(const RunFolder& folder, Trainer& trainer) {
  const PoseState& poses = trainer.model().poses;
  if (poses.empty()) return;
  const Scene& scene = trainer.scene();
  const std::vector<Camera> refined = refined_cameras(poses, scene.train_views);
  write_poses(folder.poses(), scene.train_views, refined);
  write_cameras_json(folder.cameras(), scene_with(scene, refined));
}

void save_refined_model(const RunFolder& folder, Trainer& trainer) {
  const PoseState& poses = trainer.model().poses;
  const DatasetConfig& dataset = trainer.config().dataset;
  if (poses.empty() || dataset.source.empty()) return;
  if (dataset.times == PhotoTimes::frames) {
    log_info("the photos are frames of films, so that no COLMAP model of them is written");
    return;
  }
  // The model that the run was trained with, near the origin as the run is.
  SceneModel model = read_scene(dataset, find_scene(dataset), Tracks::read);
  if (std::ranges::any_of(model.model.cameras, [](const auto& camera) {
        return camera.second.model == CameraModel::equirectangular;
      })) {
    log_info("panoramas train as halves, so that no COLMAP model of them is written");
    return;
  }
  move_near_origin(model);
  if (dataset.refine_cameras) refine_cameras(model.model);  // again, for its lenses and points
  set_poses(trainer.scene(), refined_cameras(poses, trainer.scene().train_views), model.model);
  take_off(model.model, -model.world_offset);
  write_colmap_model(folder.refined_model(), model.model);
  log_info("the refined poses are in {}, as a COLMAP model", folder.refined_model().string());
}

}  // namespace gs
