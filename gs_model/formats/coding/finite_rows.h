// SPDX-License-Identifier: Apache-2.0
// What every writer of trained Gaussians ensures: no row with NaN or infinity, rotations of length
// 1.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "gs_core/gaussians.h"

namespace gs {

/// The rows whose values, up to the SH degree, are all finite.
std::vector<std::uint32_t> finite_rows(const Gaussians& gaussians, int sh_degree);

/// Warns that rows of a model were left out of a file, if any were; returns how many.
std::size_t warn_of_left_out(const std::string& file, std::size_t written, std::size_t all);

/// Scales w x y z to length 1. A quaternion that has it to float precision stays as it is, so that
/// a file that is read and written again keeps its bytes; one of length 0 becomes the identity.
void normalize(float* wxyz);

/// The finite rows of a model, with rotations of length 1; coefficients beyond its degree are zero.
GaussianModel finite_model(const GaussianModel& model);

/// The rows source[0], source[1], ... of a model, with everything else that it says.
GaussianModel rows_of(const GaussianModel& model, const std::vector<std::uint32_t>& source);

}  // namespace gs
