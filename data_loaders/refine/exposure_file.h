// SPDX-License-Identifier: Apache-2.0
// exposure.json: how each photo of a run was exposed, {"name": [red, green, blue], ...}: the photo shows these times the
// scene's colors (display sRGB).
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "gs_core/scene.h"

namespace gs {

/// By the photos' names.
using Exposures = std::map<std::string, Vec3f>;

/// Writes those of all views, whole or not at all. Throws Error.
void write_exposures(const std::filesystem::path& path, const Scene& scene);

/// Throws Error that names the file, the photo and the remedy for anything that is not three positive numbers.
Exposures read_exposures(const std::filesystem::path& path);

/// Gives the views their exposures; those of names that are not listed stay as they are.
void apply_exposures(const Exposures& exposures, Scene& scene);

}  // namespace gs
