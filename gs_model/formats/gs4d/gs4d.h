// SPDX-License-Identifier: Apache-2.0
// .gs4d, versions 1 and 2: Gaussians in space and time as 3D Gaussians that move along lines and come and
// go (math/spacetime.h), in chunks in the order of time. Little endian; the axes are the PLY's.
//
// At a time t, 0 to 1 in the scene's duration, the Gaussian has its center at
// mean + drift (t - time_mean) / time_scale, its opacity times
// m = exp(-(t - time_mean)^2 / (2 time_scale^2)), and always the same covariance. It is not drawn
// where m < 0.05.
//
//   header, 32 bytes
//     char[4] "GS4D", u32 version, u32 Gaussians, u32 chunks,
//     u8 SH degree 0..3, u8 flags (1: antialiased), u16 0,
//     float duration of the scene in seconds (0: not known), 8 bytes 0
//   table, 16 bytes a chunk
//     u32 Gaussians (1 to 32768), u32 bytes,
//     float begin, end   the first and last time, 0 to 1, at which any of it is drawn; 2 2: never
//   chunks, one after another. Chunks that begin earlier come first. N is a chunk's Gaussians:
//     ceil(N / 256) blocks of 18 floats for each 256 Gaussians.
//     value = low + step * integer
//       float[3] low, float[3] step   of positions, world units
//       float[3] step                 of drifts, world units (low is 0)
//       float low, step               of time means
//       float low, step               of log time scales
//       float low, step               of log scales
//       float low, step               of SH coefficients of degree 0
//       float step                    of the other SH coefficients (low is 0)
//     u32[N]     rotations: which of w x y z is the largest in bits 30-31; the others in their order
//                as signed numbers of 10 bits from the lowest bits on, in units of 1/(511 sqrt(2))
//     u16[N][3]  positions
//     i16[N][3]  drifts: the way in the time of one time scale
//     u16[N][2]  time mean, log time scale
//     u8[N][3]   log scales
//     u8[N]      255 times the opacity
//     u8[N][3]   SH of degree 0, red green blue
//     i8[N][K]   the other SH, coefficient by coefficient, red green blue each; K = 0, 9, 24, 45
#pragma once

#include <filesystem>

#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"

namespace gs {

/// Reads a file as Gaussians in space and time. Their axes in 4D are found from the moments, so that
/// quaternions and scales are others than those of the model that was written, with the same
/// pictures. Throws Error, with the file and a remedy, for other versions and for damaged files.
GaussianModel read_gs4d(const std::filesystem::path& path);

/// Writes a model with time that finite_model() made. `duration` is that of the scene in seconds, 0
/// where it is not known. Throws Error as the sink does.
void write_gs4d(ByteSink& sink, const GaussianModel& model, double duration);

}  // namespace gs
