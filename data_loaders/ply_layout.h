// SPDX-License-Identifier: Apache-2.0
// Which property of a Gaussian PLY is which learned quantity: the one list that reading and writing
// share.
#pragma once

#include <vector>

#include "data_loaders/ply_file.h"
#include "gs_core/gaussians.h"

namespace gs {

/// The properties of trained Gaussians of an SH degree, in the order of the reference trainer
/// without its normals, each with its place in `gaussians`:
///   x y z                              mean                     world units
///   f_dc_0..2                          sh0                      R G B
///   f_rest_0..3K-1, K = (d+1)^2 - 1    sh_rest                  all K of R, then of G, then of B
///   opacity                            logit_opacity
///   scale_0..2                         log_scale                natural log of world units
///   rot_0..3                           rotation                 w x y z
std::vector<PlyColumn> gaussian_columns(const Gaussians& gaussians, int sh_degree);

}  // namespace gs
