// SPDX-License-Identifier: Apache-2.0
// .npz of c3dgs (Niedermayr et al. 2024): a zip archive of deflated NumPy arrays. Each Gaussian names
// an entry of a codebook of colors and one of a codebook of shapes. Axes and units are the PLY's.
//
//   xyz              f2 (N, 3)         means, world units
//   opacity          i1 (N, 1)         opacities, 0 to 1
//   scaling_factor   i1 (N, 1)         log of |s|, the length of the three standard deviations
//   feature_indices  i4 (N)            entries of the codebook of colors
//   gaussian_indices i4 (N)            entries of the codebook of shapes
//   features_dc      i1 (K, 1, 3)      sh0
//   features_rest    i1 (K, R, 3)      SH coefficients from degree 1 on, R = 15 at degree 3
//   scaling          i1 (L, 3)         s / |s|
//   rotation         i1 (L, 4)         w x y z, any length
//   quantization     b1 ()             true: the arrays of i1 are as above
//   mip_splatting    b1 ()             whether the model is antialiased; c3dgs has no such array
//
// An array X of i1 stands for (X - X_zero_point) X_scale, which are arrays of one number (i4, f4).
// Readers also take arrays of floats without these; where `quantization` is false, opacities are
// logits. Without indices, row i has entry i; without scaling_factor, `scaling` holds log scales.
#pragma once

#include <filesystem>
#include <vector>

#include "gs_core/gaussians.h"
#include "gs_core/system/files/byte_sink.h"

namespace gs {

/// How much pictures answer to the numbers of a Gaussian, (N) each, by the one that matters most:
///
///   sum over views |d(sum over pixels and channels of a view) / dp| / (pixels of all views)
///
/// p   an SH coefficient of a channel, or an entry of Sigma / |s|^2
struct RowImportance {
  std::vector<float> color, shape;
};

/// Throws Error, with the file and a remedy, for damaged files, other arrays, and where this build
/// lacks zlib.
GaussianModel read_npz(const std::filesystem::path& path);

/// Writes a model that finite_model() made, with at least one Gaussian, rows in Morton order. Both
/// codebooks have 4,096 entries at most (k_means.h), weighted by importance, and one more for each
/// Gaussian of high importance, which keeps its own: a color of one in 16 at most, and a shape of
/// one in two. Where `importance` is empty, opacity times surface (coverages_of) takes the place of
/// both kinds. The same model gives the same bytes. Throws Error where this build lacks zlib, and as
/// the sink does.
void write_npz(ByteSink& sink, const GaussianModel& model, const RowImportance& importance = {});

}  // namespace gs
