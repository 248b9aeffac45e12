// SPDX-License-Identifier: Apache-2.0
// .splat: 32 bytes a Gaussian, no header, no SH beyond degree 0. The axes are the PLY's.
//
//   float x y z         world units
//   float sx sy sz      standard deviations, world units
//   u8 r g b a          255 times the color 0.5 + C0 sh0, and times the opacity
//   u8 w x y z          128 + 128 times the rotation of length 1
#pragma once

#include <filesystem>

#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"

namespace gs {

/// Throws Error where the file is not a whole number of Gaussians.
GaussianModel read_splat(const std::filesystem::path& path);

/// Writes a model that finite_model() made, in the order of volume times opacity, largest first:
/// some viewers draw while they download. Throws Error as the sink does.
void write_splat(ByteSink& sink, const GaussianModel& model);

}  // namespace gs
