// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as PLY, the format that every viewer and trainer of 3D Gaussians reads; and
// sparse points as PLY. docs/formats/ply.md describes both.
#pragma once

#include <filesystem>
#include <vector>

#include "gs_core/gaussians.h"
#include "gs_core/scene.h"
#include "gs_core/system/files/byte_sink.h"

namespace gs {

/// Reads trained Gaussians, from ascii or binary of either byte order. Properties are looked up by
/// name: their order and types do not matter, and others are skipped. The number of f_rest_
/// properties gives the SH degree.
/// Comments: "SplatRenderMode: mip", "antialiased 1" and "postshot.anti_aliasing=1" set
/// `antialiased`, "gemsplat ..." sets `is_ours`, "world_offset X Y Z" sets `world_offset`.
/// A column filter_3D (Mip-Splatting) goes into scales and opacities (bake_filter.h); such a model
/// is `antialiased` unless a comment denies it. A PLY with packed_position is a compressed one
/// (compressed_ply.h).
/// Values are taken as they are, NaN and infinity included (inspect() counts them).
/// Throws Error, with file, place and remedy, for a file that is damaged or holds something else.
GaussianModel read_gaussian_ply(const std::filesystem::path& path);
/// The same, but a column filter_3D becomes the Gaussians' filter, and scales and opacities stay as
/// they are: for training on.
GaussianModel read_raw_gaussian_ply(const std::filesystem::path& path);

/// Writes trained Gaussians in the order of properties of the reference trainer (Kerbl et al.
/// 2023), as little-endian floats, f_rest_ for the model's degree only, rotations with length 1.
/// Positions stay near the origin, as floats must; a world offset that is not 0 becomes a comment.
/// The bytes depend on the model alone.
/// A filter becomes the last column, filter_3D.
/// Rows that hold a NaN or an infinity are left out, with a warning. Returns how many were left
/// out. Throws Error as the sink does.
std::size_t write_gaussian_ply(ByteSink& sink, const GaussianModel& model);
/// The same as a file, which appears whole or not at all; missing folders are created.
std::size_t write_gaussian_ply(const std::filesystem::path& path, const GaussianModel& model);

/// Writes sparse points: x y z nx ny nz as floats (the normals are 0), red green blue as bytes.
/// World offset, files and errors as above.
void write_point_ply(const std::filesystem::path& path, const std::vector<ScenePoint>& points,
                     const Vec3d& world_offset = Vec3d(0.0));

}  // namespace gs
