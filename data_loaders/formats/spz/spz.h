// SPDX-License-Identifier: Apache-2.0
// .spz (Niantic): six arrays of small whole numbers, gzip over everything (versions 2, 3) or zstd over each (4).
//
//   header     magic "NGSP", u32 version, u32 count, u8 SH degree, u8 fractional bits, u8 flags (1: antialiased,
//              2: extensions), u8 0; in version 4 that is u8 number of streams, and u32 where their table stands, 12 bytes 0 follow
//   positions  3 x 24 bits, signed, in units of 2^-(fractional bits) world units
//   alphas     u8   255 times the opacity
//   colors     u8   127.5 + 0.15 * 255 sh0
//   scales     u8   16 (10 + log scale)
//   rotations  version 2: x y z as 127.5 + 127.5 v, w >= 0
//              from 3: u32; which of x y z w is the largest in bits 30-31, the others as sign and 9 bits of size, the
//              last of them in the lowest bits; 511 is 1/sqrt(2)
//   sh         u8   128 + 128 c, coefficient by coefficient, R G B each
//
// The axes are x right, y up, z backwards: half a turn about x from the PLY's.
#pragma once

#include <filesystem>

#include "gs_core/gaussians.h"

namespace gs {

/// Reads versions 2, 3 and 4. Of degree 4, the coefficients beyond 3 are left out, with a warning. Throws Error, with the
/// file and a remedy, for other versions, damaged files, and where this build lacks zlib or zstd.
GaussianModel read_spz(const std::filesystem::path& path);

/// Writes version 3 or 4. The model is finite_model()'s. Positions beyond +-2048 units are written with fewer fractional
/// bits, as far as it takes, with a warning of the step that this leaves; beyond 2^23 units Error advises what to do.
/// Throws Error where the file cannot be written.
void write_spz(const std::filesystem::path& path, const GaussianModel& model, int version);

}  // namespace gs
