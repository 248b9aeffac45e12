// SPDX-License-Identifier: Apache-2.0
// Which property of a Gaussian PLY is which learned quantity: the one list that reading and writing
// share.
#pragma once

#include <string>
#include <vector>

#include "gs_core/gaussians.h"
#include "gs_model/formats/ply/ply_file.h"

namespace gs {

/// The properties of trained Gaussians of an SH degree, in the order of the reference trainer
/// without its normals, each with its place in `gaussians`:
///   x y z                              mean                     world units
///   f_dc_0..2                          sh0                      R G B
///   f_rest_0..3K-1, K = (d+1)^2 - 1    sh_rest                  all K of R, then of G, then of B
///   opacity                            logit_opacity
///   scale_0..2                         log_scale                natural log of world units
///   rot_0..3                           rotation                 w x y z
/// of Gaussians with a 3D filter (mip_filter.h)
///   filter_3D                          filter_scale             world units
/// and of Gaussians in space and time
///   right_rot_0..3                     right_rotation           w x y z
///   time_mean                          time_mean                0 to 1 is the scene's duration
///   time_scale                         log_time_scale           natural log of durations
std::vector<PlyColumn> gaussian_columns(const Gaussians& gaussians, int sh_degree);

/// The columns of the quaternions begin with these; that of the mean in time tells that rows have one.
inline constexpr const char* kFirstOfRotation = "rot_0";
inline constexpr const char* kFirstOfRightRotation = "right_rot_0";
inline constexpr const char* kTimeMean = "time_mean";
inline constexpr const char* kOlderSlope = "f_dc_slope_0";  // of models until December 2026

/// The SH degree that has this number of f_rest_ properties. Throws Error that names `path` where
/// no degree has.
int sh_degree_of(const PlyElement& element, const std::filesystem::path& path);

/// "a, b, c"
std::string list_of(const std::vector<std::string>& names);

/// Sets what the comments say of the model: `is_ours`, `antialiased`, `world_offset`.
void take_comments(const PlyHeader& header, GaussianModel& model);
/// The comment lines for take_comments().
std::string comments_of(const GaussianModel& model);

}  // namespace gs
