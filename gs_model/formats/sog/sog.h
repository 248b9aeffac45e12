// SPDX-License-Identifier: Apache-2.0
// .sog, version 2 (PlayCanvas): a zip archive of lossless WebP pictures, one pixel for each
// Gaussian, and meta.json, which says what their bytes mean. The same files may lie in a folder.
// Axes and units are the PLY's.
//
//   means_l, means_u   r g b: low and high byte of sign(x) ln(1 + |x|) in 16 bits from mins to maxs
//   quats              r g b: three of w x y z as (0.5 + v / sqrt(2)) * 255
//                      a: 252 + which of them is left out, the largest
//   scales             r g b: indices into a codebook of log scales
//   sh0                r g b: indices into a codebook of sh0; a: 255 times the opacity
//   shN_labels         r g: low and high byte of the number of a palette entry
//   shN_centroids      the palette, 64 entries a row, a pixel for each coefficient
//                      r g b: indices into a codebook
#pragma once

#include <filesystem>

#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"

namespace gs {

/// Throws Error, with the file and a remedy, for damaged files, other versions, and where this
/// build lacks libwebp.
GaussianModel read_sog(const std::filesystem::path& path);

/// The same for a folder: `path` is its meta.json, beside which the pictures lie. Files of other
/// folders are never read.
GaussianModel read_sog_folder(const std::filesystem::path& path);

/// Writes a model that finite_model() made, with at least one Gaussian, rows in Morton order. The
/// same model gives the same bytes. Throws Error where this build lacks libwebp, and as the sink
/// does.
void write_sog(ByteSink& sink, const GaussianModel& model);

}  // namespace gs
