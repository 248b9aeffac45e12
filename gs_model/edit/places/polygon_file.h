// SPDX-License-Identifier: Apache-2.0
// Files with areas: vertices as text, or GeoJSON.
#pragma once

#include <filesystem>

#include "gs_model/edit/polygon.h"

namespace gs {

/// Reads an area. Throws Error that names the file, the line or ring, and a remedy.
///
///   text      a vertex a line, two numbers with a comma or spaces between; an empty line begins the
///             next ring; lines that begin with # are comments
///   GeoJSON   all rings of its Polygons and MultiPolygons; a file that begins with {
Polygon read_polygon(const std::filesystem::path& file);

}  // namespace gs
