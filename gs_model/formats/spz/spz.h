// SPDX-License-Identifier: Apache-2.0
// .spz (Niantic): six arrays of small whole numbers. Versions 2 and 3 are one gzip file of them
// all; version 4 has a zstd stream for each array that is not empty, so five at SH degree 0.
//
//   header     magic "NGSP", u32 version, u32 count, u8 SH degree, u8 fractional bits,
//              u8 flags (1: antialiased, 2: extensions), u8 0
//              in version 4 the last byte is the number of streams; then follow u32 where their
//              table stands, and 12 bytes 0
//   positions  3 x 24 bits, signed, in units of 2^-(fractional bits) world units
//   alphas     u8   255 times the opacity
//   colors     u8   127.5 + 0.15 * 255 sh0
//   scales     u8   16 (10 + log scale)
//   rotations  version 2: x y z as 127.5 + 127.5 v, w >= 0
//              from 3: u32; which of x y z w is the largest in bits 30-31, the others as sign
//              and 9 bits of size, the last of them in the lowest bits; 511 is 1/sqrt(2)
//   sh         u8   128 + 128 c, coefficient by coefficient, R G B each
//
// The axes are x right, y up, z backwards: half a turn about x from the PLY's.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"
#include "gs_model/formats/coding/frame.h"

namespace gs {

/// Reads versions 2, 3 and 4. A file of SH degree 4 loses the coefficients of that degree, with a
/// warning. Throws Error, with the file and a remedy, for other versions, for damaged files, and
/// where this build lacks zlib or zstd.
GaussianModel read_spz(const std::filesystem::path& path);

/// The same for the bytes of an .spz that stands inside the file `path`. `signs` lead from its axes
/// to the PLY's.
GaussianModel spz_model(const std::filesystem::path& path, std::string_view bytes,
                        const AxisSigns& signs);

/// What an .spz holds in full: positions within 2048 units of the origin, standard deviations up to
/// 379 units. Farther positions take coarser steps, up to 2^23 units; larger Gaussians are cut
/// down.
inline constexpr double kSpzFineReach = 2048, kSpzReach = 8'388'000, kSpzLargestSigma = 379;

/// What users choose of a file.
struct SpzOptions {
  int version = 3;  // 2 to 4
  // Bits of an SH coefficient, 1 to 8; 0: 5 at degree 1 and 4 beyond it, as other writers have it.
  // A byte is kept for each one: fewer bits make what is packed smaller.
  int sh_bits = 0;
};

/// The bytes of an .spz. `signs` lead from the PLY's axes to those of its
/// numbers: kHalfTurnX as in a file of its own (RUB), (1, 1, 1) for readers that take the numbers
/// as they are. The model is one that finite_model() made, with positions within kSpzReach.
std::string spz_bytes(const GaussianModel& model, const SpzOptions& options,
                      const AxisSigns& signs);

/// Writes an .spz of a model that finite_model() made. Positions beyond +-2048 units take
/// fewer fractional bits in the whole file; a warning says how large the steps then are. Throws
/// Error for positions beyond 2^23 units, and as the sink does.
void write_spz(ByteSink& sink, const GaussianModel& model, const SpzOptions& options);

}  // namespace gs
