// SPDX-License-Identifier: Apache-2.0
// gemsplat render --path: works out the camera of each frame from the kind of path and a few
// numbers.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "data_loaders/cameras/camera_file.h"
#include "gs_core/buffer.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// A path through all cameras that are given, in their order: those of a file (key_frames.h).
inline constexpr const char* kKeyFrames = "FILE";

/// What the command line asks for.
struct PathRequest {
  std::string kind;  // "orbit", "spline", "flythrough", kKeyFrames; empty: none
  std::size_t frames = 0;
  std::vector<std::string> through;  // spline: names or numbers of cameras; empty: `keys` of all
  int keys = 12;                     // cameras that a spline or flythrough passes
  bool is_loop = false;              // it goes back to its first camera
  std::string pace = "even";         // or "keys"
  // From here on: of an orbit. Not set: once around, or to and fro where photos were taken
  std::optional<double> turns;
  std::optional<double> elevation;  // degrees
  std::optional<double> radius;     // world units
  std::optional<Vec3d> center;      // world units; not set: the point the cameras look at
};

/// A camera for each frame, named "00000", "00001", ..., and a description for the file beside the
/// film.
struct FilmPath {
  std::vector<NamedCamera> cameras;
  Json description;
};

/// The path among `cameras`, in their frame. There is at least one. Frames have the lens and size
/// of the first camera that the path passes; those of an orbit have the first camera's.
///
/// points         of the scene, such as the Gaussians' means; they help to find an orbit's center
/// world_offset   of the cameras' frame; positions in `request` and in the description have it
///                added
///
/// Throws UsageError for unknown names of cameras, and for too few cameras.
FilmPath film_path(const PathRequest& request, const std::vector<NamedCamera>& cameras,
                   Span<const Vec3f> points, const Vec3d& world_offset);

}  // namespace gs
