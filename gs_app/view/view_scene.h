// SPDX-License-Identifier: Apache-2.0
// What `gemsplat view` shows besides the Gaussians: cameras with their photos, and where a look
// around begins.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/scene.h"
#include "gs_core/scene_frame.h"
#include "gs_render/render_pass.h"

namespace gs {

/// A camera of the scene. `view` has its photo, at the camera's size; null where there is none.
struct ViewedCamera {
  std::string name;
  std::string split;  // "train", "test", or "" where it is not known
  Camera camera;
  const View* view = nullptr;
};

/// How the cameras stand around what they look at, or the points without cameras: a look around
/// begins there.
SceneFrame frame_of(const std::vector<ViewedCamera>& cameras, Span<const Vec3f> points);

/// Cameras, where a look around begins, and the owner of the photos.
struct ViewScene {
  std::string title;
  Vec3f background{0};
  float near_plane = 0.2f, far_plane = 10000;  // world units of depth: what is shown lies between
  std::vector<ViewedCamera> cameras;
  SceneFrame frame;
  std::vector<std::string> notes;            // what is missing, and why
  std::shared_ptr<const Scene> photos = {};  // owner of the views, unless they are somebody else's
};

/// What /scene.json says, but for "mode" and "model".
nlohmann::ordered_json scene_json(const ViewScene& scene);

/// Takes what the pictures' settings say.
void take_settings(ViewScene& scene, const RenderSettings& settings);

/// All views of a scene as cameras with photos: the test views first, as in cameras.json.
std::vector<ViewedCamera> viewed_cameras(const Scene& scene);

}  // namespace gs
