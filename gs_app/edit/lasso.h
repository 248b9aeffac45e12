// SPDX-License-Identifier: Apache-2.0
// A closed line, or strokes of a brush, in a picture of a model, as the viewer's tool Lasso writes
// them for `edit --drop lasso=FILE`.
#pragma once

#include <filesystem>
#include <vector>

#include "gs_core/camera.h"

namespace gs {

struct Lasso {
  Camera camera;
  // Pixels of the camera's picture. A line is closed: its last corner is joined to its first.
  std::vector<Vec2f> line;
  std::vector<std::vector<Vec2f>> strokes;  // of a brush, where there is no line
  float radius = 0;                         // of the brush, pixels

  /// Whether the camera shows a point inside of the line or under the brush, however much lies in
  /// front of it; of what the line goes around twice, nothing is inside (even-odd rule).
  bool holds(const Vec3f& point) const;
};

/// Reads {"format": "gemsplat lasso", "version": 1, "camera": as one of cameras.json, "line":
/// [[x, y], ...]} with at least three corners, or with "strokes": [[[x, y], ...], ...], "radius":
/// pixels in the place of a line. Throws Error that names the file and what is wrong.
Lasso read_lasso(const std::filesystem::path& file, const Vec3d& world_offset);

}  // namespace gs
