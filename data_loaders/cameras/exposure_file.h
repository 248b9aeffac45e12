// SPDX-License-Identifier: Apache-2.0
// exposure.json: the exposure of each photo of a run, {"name": [red, green, blue], ...}. The photo
// shows the scene's colors times these factors (display sRGB).
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "gs_core/scene.h"

namespace gs {

/// Factors by the names of photos.
using Exposures = std::map<std::string, Vec3f>;

/// Writes the exposures of all views, whole or not at all. Throws Error.
void write_exposures(const std::filesystem::path& path, const Scene& scene);

/// Throws Error that names the file, the photo and a remedy where a value is not three positive
/// numbers.
Exposures read_exposures(const std::filesystem::path& path);

/// Gives the views their exposures. Views that are not listed keep theirs.
void apply_exposures(const Exposures& exposures, Scene& scene);

}  // namespace gs
