// SPDX-License-Identifier: Apache-2.0
// gemsplat render --path: from a word and a few numbers to the camera of each frame.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "data_loaders/cameras/camera_file.h"
#include "gs_core/buffer.h"

namespace gs {

/// What the command line asks for.
struct PathRequest {
  std::string kind;                  // "orbit", "spline", "flythrough"; empty: none
  std::size_t frames = 0;
  std::vector<std::string> through;  // of a spline: names or numbers of cameras; empty: `keys` of them
  int keys = 12;                     // cameras that a spline or flythrough passes
  bool is_loop = false;              // a spline goes back to its first camera
  std::string pace = "even";         // or "keys"
  double turns = 1;                  // the rest is of an orbit
  std::optional<double> elevation;   // degrees
  std::optional<double> radius;      // world units
  std::optional<Vec3d> center;       // world units; that which the cameras look at
};

/// A camera for each frame, named "00000", "00001", ..., and what the path is, for the file beside the film.
struct FilmPath {
  std::vector<NamedCamera> cameras;
  nlohmann::ordered_json description;
};

/// The path among `cameras`, of which there is one at least, in their frame, with the lens and size of the first one that it passes (of an orbit, of the
/// first of all).
///
/// points         of the scene, such as the Gaussians' means; an orbit's center is found with them (scene_frame)
/// world_offset   of that frame: positions in `request` and in the description have it added
///
/// Throws UsageError for cameras that are none of these, or too few.
FilmPath film_path(const PathRequest& request, const std::vector<NamedCamera>& cameras,
                   Span<const Vec3f> points, const Vec3d& world_offset);

}  // namespace gs
