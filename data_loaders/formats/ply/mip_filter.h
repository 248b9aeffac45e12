// SPDX-License-Identifier: Apache-2.0
// The 3D smoothing filter of Mip-Splatting, which its PLYs carry in a column "filter_3D" beside
// scales and opacities that lack it. Other trainers, such as GOF and RaDe-GS, write the same
// column.
#pragma once

#include <vector>

#include "data_loaders/formats/ply/ply_header.h"
#include "gs_core/gaussians.h"

namespace gs {

inline constexpr const char* kFilter3dProperty = "filter_3D";

/// Whether trained Gaussians in a PLY have that column.
bool has_filter_3d(const PlyHeader& header);

/// Puts the filter into scales and opacities, so that the column is not needed any more:
///
///   S'^2 = S^2 + f^2 I        o' = o sqrt(det(S^2) / det(S^2 + f^2 I))        Yu et al. 2024, Eq.
///                             7
///
/// f   (N) `filter`, standard deviations of the filter   world units
/// S   diagonal, the standard deviations of a Gaussian   world units
/// Rows with f = 0 keep their bits.
void bake_filter_3d(const Gaussians& gaussians, const std::vector<float>& filter);

}  // namespace gs
