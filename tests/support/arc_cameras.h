// SPDX-License-Identifier: Apache-2.0
// Cameras on a circle, for tests of frames and paths.
#pragma once

#include "gs_render/paths/camera_path.h"
#include "tests/support/test.h"

namespace gs {

inline const Vec3d kUp{0.0, 0.0, 1.0};

inline double norm(const Vec3d& v) { return std::sqrt(inner(v, v)); }

inline Camera looking(const Vec3d& from, const Vec3d& to) {
  Camera camera;
  camera.width = 40, camera.height = 30, camera.fx = camera.fy = 40, camera.cx = 20, camera.cy = 15;
  return with_pose(camera, {from, looking_at(from, to, kUp)});
}

/// Cameras on a part of a circle of radius 4 at height 3 about (5, 6, 7), looking at its center
/// from 5 units away.
inline std::vector<Camera> arc(int count, double part) {
  std::vector<Camera> cameras;
  for (int i = 0; i < count; ++i) {
    const double angle = 2 * std::numbers::pi * part * i / count;
    const Vec3d center(5.0, 6.0, 7.0);
    cameras.push_back(
        looking(center + Vec3d(4 * std::cos(angle), 4 * std::sin(angle), 3.0), center));
  }
  return cameras;
}

}  // namespace gs
