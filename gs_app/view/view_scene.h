// SPDX-License-Identifier: Apache-2.0
// What the viewer shows besides the Gaussians: cameras with their photos, and the first view.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/geometry/scene_frame.h"
#include "gs_core/scene.h"
#include "gs_core/system/text/json.h"
#include "gs_eval/looks/scene_looks.h"
#include "gs_render/render_pass.h"

namespace gs {

/// A camera of the scene. `view` has its photo, at the camera's size; it is null if there is none.
struct ViewedCamera {
  std::string name;
  std::string split;  // "train", "test", or "" if it is not known
  Camera camera;
  const View* view = nullptr;
  std::string look = {};  // the name of its photo in ViewScene::looks; "" if it is not there
};

/// The position of the cameras around the point that they look at, or the frame of the points if
/// there are no cameras. The first view is computed from it.
SceneFrame frame_of(const std::vector<ViewedCamera>& cameras, Span<const Vec3f> points);

/// Cameras, their frame, rendering settings, and the owner of the photos.
struct ViewScene {
  std::string title;
  Vec3f background{0};
  // Depths in world units: nothing outside them is drawn.
  float near_plane = 0.2f, far_plane = 10000;
  std::vector<ViewedCamera> cameras;
  SceneFrame frame;
  std::optional<Vec3d> eye = {};    // where to begin if the scene has no cameras; else from outside
  bool moves = false;               // the model has a time, which the page can choose
  std::optional<double> time = {};  // at which the page begins; it plays if there is none
  std::vector<std::string> notes;   // sentences for the user: what is missing, and why
  Vec3d world_offset{0.0};  // to be added for the coordinates that people know (`gemsplat edit`)
  std::optional<double> meters_per_unit = {};    // of a scene that knows where on earth it stands
  std::shared_ptr<const SceneLooks> looks = {};  // learned colors of photos; null: there are none
  std::shared_ptr<const Scene> photos = {};      // owner of the views; null if the caller owns them
  std::filesystem::path mesh = {};               // a .glb of triangles; empty: there is none
  std::string path = {};  // of the model, as the command line names it; only this machine sees it
};

/// The last name of a path, as the page's title: others need not see where it lies. "runs/a/" ->
/// "a", "." -> the name of the current folder.
std::string name_of(const std::filesystem::path& path);

/// [x, y, z]
Json list_of(const Vec3d& v);
/// The list "cameras" of it, by itself.
Json cameras_json(const std::vector<ViewedCamera>& cameras);
/// /scene.json without "mode", "model" and "path".
Json scene_json(const ViewScene& scene);

/// Copies the background and the depth range from the rendering settings.
void take_settings(ViewScene& scene, const RenderSettings& settings);

/// Sets meters_per_unit if the scene's folder has a georef.json. `input_from_model` is the scale of
/// the photos' frame to that of the model. Notes what cannot be read.
void take_meters(ViewScene& scene, const std::filesystem::path& source, double input_from_model);

/// All views of a scene as cameras with photos: the test views first, as in cameras.json.
std::vector<ViewedCamera> viewed_cameras(const Scene& scene);

}  // namespace gs
