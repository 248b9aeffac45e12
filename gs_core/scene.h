// SPDX-License-Identifier: Apache-2.0
// What training starts from: posed photos and sparse points, const once loaded.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "gs_core/camera.h"
#include "gs_core/image.h"

namespace gs {

/// One posed photo.
struct View {
  std::string name;  // path of the photo relative to the images folder, as in the COLMAP model
  Camera camera;
  Image8 photo;      // (height, width, 3) of the camera's size
  Vec3f exposure{1};  // per channel: the photo shows exposure * the scene's colours (display sRGB)
};

/// A point of the sparse reconstruction.
struct ScenePoint {
  Vec3f position;                    // world units
  std::array<std::uint8_t, 3> color;  // sRGB
};

/// How well the views' exposures explain their colours: the spread of a point's colours over photos, relative, with
/// exposures 1 and with those solved.
struct ExposureSummary {
  std::size_t samples = 0;
  double spread_before = 0, spread_after = 0;
};

/// What refining the cameras came to. Errors are lengths in pixels between where points are seen and where they land.
struct CameraRefinement {
  std::size_t observations = 0, images = 0, points = 0;  // that took part
  double mean_error_before = 0, mean_error_after = 0;
  double median_error_before = 0, median_error_after = 0;
  int steps = 0;  // of the solver
  bool has_converged = false;
  double seconds = 0;
};

/// All views with their split, and the sparse points. Views are sorted by name in byte order.
struct Scene {
  std::vector<View> train_views, test_views;
  std::vector<ScenePoint> points;
  std::string source;  // the folder it was loaded from
  float extent = 1;    // 1.1 * the largest distance of a training camera from their mean, strays left out; world units
  Vec3d world_offset{0.0, 0.0, 0.0};  // was taken off all coordinates: add it to have the model's own; 0 for most
  std::optional<CameraRefinement> refinement;  // where cameras were refined
  std::optional<ExposureSummary> exposure;  // where exposures were solved for
};

/// Cameras that stand far away from all others, mostly by a wrong pose: more than ten times as far from the median
/// position as nine in ten of the cameras. Indices, ascending; at most a tenth of all.
std::vector<std::size_t> stray_cameras(const std::vector<View>& views);

/// Extent of a set of cameras, as the position learning rate and the density rules use it
/// (Kerbl et al. 2023), stray cameras left out. Returns 1 for fewer than two distinct positions.
float camera_extent(const std::vector<View>& views);

}  // namespace gs
