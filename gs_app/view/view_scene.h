// SPDX-License-Identifier: Apache-2.0
// What the viewer shows besides the Gaussians: cameras with their photos, and the first view.
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

/// A camera of the scene. `view` has its photo, at the camera's size; it is null if there is none.
struct ViewedCamera {
  std::string name;
  std::string split;  // "train", "test", or "" if it is not known
  Camera camera;
  const View* view = nullptr;
};

/// Where navigation starts, in world units.
struct Framing {
  Vec3d up{0, -1, 0};      // a direction of length 1
  Vec3d center{0, 0, 0};   // the point that the cameras look at
  double radius = 1;       // of the cameras around it, or of the Gaussians if there are no cameras
};

/// `up` is the mean of the cameras' up directions. The center is the point nearest to all lines of
/// sight; along lines that are all parallel it lies at the median of `points`. Without cameras the
/// center and the radius are those of the points, and y points down, as in COLMAP. A sample of some
/// 100,000 points is used; those with NaN or infinity are ignored.
Framing framing_of(const std::vector<ViewedCamera>& cameras, Span<const Vec3f> points);

/// Cameras, framing and rendering settings, and the owner of the photos.
struct ViewScene {
  std::string title;
  Vec3f background{0};
  // Depths in world units: nothing outside them is drawn.
  float near_plane = 0.2f, far_plane = 10000;
  std::vector<ViewedCamera> cameras;
  Framing framing;
  std::vector<std::string> notes;            // sentences for the user: what is missing, and why
  std::shared_ptr<const Scene> photos = {};  // owner of the views; null if the caller owns them
};

/// /scene.json without "mode" and "model".
nlohmann::ordered_json scene_json(const ViewScene& scene);

/// Copies the background and the depth range from the rendering settings.
void take_settings(ViewScene& scene, const RenderSettings& settings);

/// All views of a scene as cameras with photos: the test views first, as in cameras.json.
std::vector<ViewedCamera> viewed_cameras(const Scene& scene);

}  // namespace gs
