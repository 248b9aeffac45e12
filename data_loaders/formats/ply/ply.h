// SPDX-License-Identifier: Apache-2.0
// Trained Gaussians as PLY, the format that every viewer and trainer of 3D Gaussians reads; and
// sparse points as PLY. docs/conventions.md describes both.
#pragma once

#include <filesystem>
#include <vector>

#include "gs_core/gaussians.h"
#include "gs_core/scene.h"

namespace gs {

/// Reads trained Gaussians. Properties are looked up by name: their order, their types and whatever
/// else the file holds do not matter; nor does its format (ascii, binary of either byte order). The
/// number of f_rest_ properties gives the SH degree; the comments "SplatRenderMode: mip" and
/// "antialiased 1" set `antialiased`; "gemsplat ..." sets `is_ours`; "world_offset X Y Z" sets that.
/// A compressed PLY is told by its packed_position (formats/compressed_ply.h).
/// Values are taken as they are, NaN and infinity too (inspect() counts them).
/// Throws Error, with file, place and remedy, for a file that is damaged or holds something else.
GaussianModel read_gaussian_ply(const std::filesystem::path& path);

/// Writes trained Gaussians in the order of properties of the reference trainer (Kerbl et al.
/// 2023), as little-endian floats, f_rest_ for the model's degree only, rotations with length 1.
/// Positions stay near the origin, as floats must; a world offset that is not 0 becomes a comment.
/// The bytes depend on the model alone. The file is there whole or not at all; folders above it are
/// created.
/// Rows that hold a NaN or an infinity are left out; returns how many, and logs a warning if there
/// are any.
/// Throws Error with the path where it cannot be written.
std::size_t write_gaussian_ply(const std::filesystem::path& path, const GaussianModel& model);

/// Writes sparse points: x y z nx ny nz as floats (the normals are 0), red green blue as bytes.
/// World offset, files and errors as above.
void write_point_ply(const std::filesystem::path& path, const std::vector<ScenePoint>& points,
                     const Vec3d& world_offset = Vec3d(0.0));

}  // namespace gs
