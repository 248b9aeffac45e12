// SPDX-License-Identifier: Apache-2.0
// extreme_saving.zip of LightGaussian (Fan et al. 2024), "VecTree": a zip archive with a folder of
// .npz files, of one array each, which is called arr_0. Axes and units are the PLY's.
//
//   extreme_saving/xyz.npz              f4 (N, 3)  means, world units
//   extreme_saving/other_attribute.npz  f2 (N, 8)  logit opacity, three log scales, rotation w x y z
//   extreme_saving/non_vq_mask.npz      u1         N bits: whether a Gaussian keeps its own color
//   extreme_saving/non_vq_feats.npz     f2 (., D)  colors of those Gaussians
//   extreme_saving/vq_indexs.npz        u1         floor(log2 K) bits for each of the others
//   extreme_saving/codebook.npz         f2 (K, D)  colors of the others
//   extreme_saving/metadata.npz         a pickled dict of N, the PLY's columns, K and D
//
// A color is sh0, and then the SH coefficients from degree 1 on of red, of green and of blue:
// D = 27 at degree 2. Bits begin with the highest one of a byte and of a number. The reader needs no
// metadata, and takes the name of a file from behind its last slash.
#pragma once

#include <filesystem>

#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"
#include "gs_model/formats/npz/npz.h"

namespace gs {

/// Throws Error, with the file and a remedy, for damaged files, other arrays, and where this build
/// lacks zlib.
GaussianModel read_vectree(const std::filesystem::path& path);

/// Writes a model that finite_model() made, with at least one Gaussian. The two fifths of largest
/// color importance keep their own colors, and the others share 8,192 (k_means.h), weighted by
/// it. Where `importance` is empty, opacity times surface (coverages_of) takes its place. The same
/// model gives the same bytes. Throws Error where this build lacks zlib, and as the sink does.
void write_vectree(ByteSink& sink, const GaussianModel& model,
                   const RowImportance& importance = {});

}  // namespace gs
