// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as a table of text: the names and units of the PLY in the first line, a Gaussian in each line after it.
// Numbers have as many digits as it takes to read the same float again.
#pragma once

#include <filesystem>

#include "gs_core/gaussians.h"

namespace gs {

/// Reads one: columns by name, in any order; others are passed over. Lines end in LF or CRLF. Throws Error that names
/// the file, line and column.
GaussianModel read_csv(const std::filesystem::path& path);

/// The model is finite_model()'s. Throws Error where the file cannot be written.
void write_csv(const std::filesystem::path& path, const GaussianModel& model);

}  // namespace gs
