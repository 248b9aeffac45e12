// SPDX-License-Identifier: Apache-2.0
// .ksplat, version 0.1 (GaussianSplats3D): sections of Gaussians in rows, as floats (level 0) or
// packed (levels 1 and 2). Positions of packed rows are relative to the bucket that they lie in.
//
//   header, 4096 bytes
//      0  u8 0, u8 1 (version)        4  u32 sections        16  u32 Gaussians
//     20  u16 level 0..2             36  float least and     40  float largest SH of level 2;
//                                        0 and 0 mean -1.5 and 1.5
//   for each section, 1024 bytes
//      0  u32 Gaussians               4  u32 rows            8  u32 rows of a full bucket, B
//     12  u32 buckets                16  float bucket size S, world units
//     20  u16 bytes of a center, 12  24  u32 range Q; 0 means 32767
//     32  u32 full buckets           36  u32 other buckets   40  u16 SH degree
//   for each section
//     u32 rows of each bucket that is not full, then float x y z of the center of every bucket
//     rows           level 0     level 1                        level 2
//       position     float[3]    u16[3]: center + (p - Q) S / 2Q    as level 1
//       scale        float[3]    f16[3]                             as level 1
//       rotation     float[4]    f16[4]: w x y z                    as level 1
//       color        u8[4]       u8[4]: r g b of degree 0, opacity  as level 1
//       SH           float[]     f16[]                              u8[]: least to largest
//
// SH are in blocks of a degree, each with all coefficients of red, then of green, then of blue.
// Scales are standard deviations in world units, and axes are the PLY's. Levels 1 and 2 have the
// first B rows in the first full bucket, and so on.
#pragma once

#include <filesystem>

#include "gs_core/gaussians.h"

namespace gs {

/// Throws Error, with the file and a remedy, for other versions and levels, and for damaged files.
GaussianModel read_ksplat(const std::filesystem::path& path);

}  // namespace gs
