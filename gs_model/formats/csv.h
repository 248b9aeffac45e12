// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as a table of text: the names and units of the PLY in the first line, then one
// line for each Gaussian. A number has as many digits as it takes to read the same float again.
//
// Positions are those of the photos: the world offset of a scene far from the origin is added back,
// in double precision. 500123.25 in a scene of UTM coordinates stays 500123.25.
#pragma once

#include <filesystem>

#include "gs_core/gaussians.h"

namespace gs {

/// Reads a table: columns by name, in any order; other columns are skipped. Lines end in LF or
/// CRLF. Positions too far from the origin for floats are moved near it, and `world_offset` says by
/// how much. Throws Error that names the file, line and column.
GaussianModel read_csv(const std::filesystem::path& path);

/// Writes a model that finite_model() made. Throws Error where the file cannot be written.
void write_csv(const std::filesystem::path& path, const GaussianModel& model);

}  // namespace gs
