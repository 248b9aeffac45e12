// SPDX-License-Identifier: Apache-2.0
// The 3D smoothing filter of Mip-Splatting, which its PLYs carry in a column "filter_3D", its
// standard deviation in world units, beside scales and opacities that lack it. Other trainers, such
// as GOF and RaDe-GS, write the same column.
#pragma once

#include "gs_model/formats/ply/ply_header.h"

namespace gs {

inline constexpr const char* kFilter3dProperty = "filter_3D";

/// Whether trained Gaussians in a PLY have that column.
bool has_filter_3d(const PlyHeader& header);

}  // namespace gs
