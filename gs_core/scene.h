// SPDX-License-Identifier: Apache-2.0
// What training starts from: posed photos and sparse points, const once loaded.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/image.h"

namespace gs {

/// One posed photo. math/photo_weight.h has what the loss makes of mask and exposure.
struct View {
  std::string name;  // path of the photo relative to the images folder, as in the COLMAP model
  Camera camera;
  Image8 photo;      // (height, width, 3) of the camera's size
  Image8 mask = {};  // (height, width, 1) of that size: 255 trains, 0 does not; empty: every pixel trains
  bool over_background = false;  // the mask says what the photo covers: the background is behind it, and every pixel trains
  Vec3f exposure{1};  // per channel: the photo shows exposure * the scene's colours (display sRGB)

  /// Whether the photo stands for more than itself in the loss.
  bool is_weighted() const {
    return !mask.empty() || exposure.x != 1 || exposure.y != 1 || exposure.z != 1;
  }
  /// Whether there are pixels that do not train, or less than others.
  bool has_untrained_pixels() const { return !mask.empty() && !over_background; }
};

/// A point of the sparse reconstruction.
struct ScenePoint {
  Vec3f position;                    // world units
  std::array<std::uint8_t, 3> color;  // sRGB
};

/// All views with their split, and the sparse points. Views are sorted by name in byte order.
struct Scene {
  std::vector<View> train_views, test_views;
  std::vector<ScenePoint> points;
  std::string source;  // the folder it was loaded from
  float extent = 1;    // 1.1 * the largest distance of a training camera from their mean, strays left out; world units
};

/// Cameras that stand far away from all others, mostly by a wrong pose: more than ten times as far from the median
/// position as nine in ten of the cameras. Indices, ascending; at most a tenth of all.
std::vector<std::size_t> stray_cameras(const std::vector<View>& views);

/// Extent of a set of cameras, as the position learning rate and the density rules use it
/// (Kerbl et al. 2023), stray cameras left out. Returns 1 for fewer than two distinct positions.
float camera_extent(const std::vector<View>& views);

}  // namespace gs
