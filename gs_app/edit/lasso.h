// SPDX-License-Identifier: Apache-2.0
// A closed line in a picture of a model, as the viewer's tool Lasso writes it for `edit --drop
// lasso=FILE`.
#pragma once

#include <filesystem>
#include <vector>

#include "gs_core/camera.h"

namespace gs {

struct Lasso {
  Camera camera;
  std::vector<Vec2f>
      line;  // corners, pixels of the camera's picture; the last is joined to the first

  /// Whether the camera shows a point inside of the line, however much lies in front of it; of what
  /// the line goes around twice, nothing is inside (even-odd rule).
  bool holds(const Vec3f& point) const;
};

/// Reads {"format": "gemsplat lasso", "version": 1, "camera": as one of cameras.json, "line":
/// [[x, y], ...]} with at least three corners. Throws Error that names the file and what is wrong.
Lasso read_lasso(const std::filesystem::path& file, const Vec3d& world_offset);

}  // namespace gs
