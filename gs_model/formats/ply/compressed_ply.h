// SPDX-License-Identifier: Apache-2.0
// Compressed PLY (PlayCanvas, SuperSplat): 16 bytes for a Gaussian, one for each SH number, and 72
// for each chunk of 256 Gaussians. Positions, scales and colors are fractions of the chunk's range.
//
//   element chunk   min_x y z  max_x y z  min_scale_x y z  max_scale_x y z  min_r g b  max_r g b;
//                                         floats
//   element vertex  packed_position  x 11 bits, y 10, z 11: fractions of the chunk's range of means
//                   packed_rotation  which of w x y z is the largest (2 bits), the others 10 bits
//                                    each
//                   packed_scale     as the position, for log scales clamped to +-20
//                   packed_color     r g b of 0.5 + C0 sh0 in the chunk's range, opacity; 8 bits
//                                    each
//   element sh      f_rest_*, bytes: 128 + 32 times the coefficient
//
// Axes, order of coefficients and comments are those of the plain PLY.
#pragma once

#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"
#include "gs_model/formats/ply/ply_file.h"

namespace gs {

/// Whether this is the header of one: its vertices have a packed_position.
bool is_compressed_ply(const PlyHeader& header);

/// Reads one, with properties in any order. Chunks without colors (older files) have the range
/// 0..1. Throws Error, with file, place and remedy, where it is damaged.
GaussianModel read_compressed_ply(PlyFile& file);

/// Writes a model that finite_model() made, rows in Morton order. Throws Error as the sink
/// does.
void write_compressed_ply(ByteSink& sink, const GaussianModel& model);

}  // namespace gs
