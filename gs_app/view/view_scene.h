// SPDX-License-Identifier: Apache-2.0
// What `gemsplat view` shows besides the Gaussians: cameras with their photos, and where a look around begins.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/gaussians.h"
#include "gs_core/scene.h"
#include "gs_render/render_pass.h"

namespace gs {

/// A camera of the scene. `view` has its photo, at the camera's size; null where there is none.
struct ViewedCamera {
  std::string name;
  std::string split;  // "train", "test", or "" where it is not known
  Camera camera;
  const View* view = nullptr;
};

/// Where a look around begins, in world units.
struct Framing {
  Vec3d up{0, -1, 0};      // a direction of length 1
  Vec3d center{0, 0, 0};   // what cameras look at
  double radius = 1;       // of the cameras around it, or of the Gaussians where no camera is there
};

/// Up is the mean of the cameras' own; the center is nearest to where they look, and near the middle of `points` where their
/// directions do not say it. Without cameras both come from the points, whose y axis points down (COLMAP's habit). At most
/// some 100,000 points, evenly chosen, are looked at; those with NaN or infinity are left out.
Framing framing_of(const std::vector<ViewedCamera>& cameras, Span<const Vec3f> points);

/// Cameras and framing, and what keeps the photos.
struct ViewScene {
  std::string title;
  Vec3f background{0};
  float near_plane = 0.2f, far_plane = 10000;  // world units of depth: what is shown lies between
  std::vector<ViewedCamera> cameras;
  Framing framing;
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
