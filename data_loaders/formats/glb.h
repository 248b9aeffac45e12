// SPDX-License-Identifier: Apache-2.0
// glTF 2.0, binary, with the extension KHR_gaussian_splatting: a mesh of points whose attributes are those of Gaussians, after
// activation. Viewers without the extension show colored points.
//
//   POSITION                                       float x y z      half a turn about z from the PLY's axes: y up
//   COLOR_0                                        u8 r g b a       linear, for viewers without the extension
//   KHR_gaussian_splatting:ROTATION                float x y z w    turned with the positions, length 1
//   KHR_gaussian_splatting:SCALE                   float x y z      standard deviations, world units
//   KHR_gaussian_splatting:OPACITY                 float            0..1
//   KHR_gaussian_splatting:SH_DEGREE_d_COEF_k      float r g b      turned, too
#pragma once

#include <filesystem>

#include "gs_core/gaussians.h"

namespace gs {

/// The model is finite_model()'s. Throws Error for a model without Gaussians, which glTF cannot hold, for one of more than
/// 4 GiB, and where the file cannot be written.
void write_glb(const std::filesystem::path& path, const GaussianModel& model);

}  // namespace gs
