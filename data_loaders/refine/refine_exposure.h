// SPDX-License-Identifier: Apache-2.0
// Solves for the brightness and tint of each photo, from the colors that photos give to the points
// they share.
#pragma once

#include <vector>

#include "data_loaders/refine/color_samples.h"

namespace gs {

/// The exposures of all photos, and how well they explain the samples.
struct ExposureFit {
  std::vector<Vec3f> exposures;                // (photos) per channel: photo = exposure * scene
  double spread_before = 0, spread_after = 0;  // of a point's colors over photos; relative, robust
  std::size_t sample_count = 0;
  std::vector<std::size_t> unknown;  // photos with too few samples: 1 in every channel
};

/// ExposureFit::spread_before of these samples.
double spread_of(const std::vector<ColorSample>& samples, std::size_t photos);

/// Whether this build can refine anything: it has Ceres.
bool can_refine();

/// Throws Error that names the option where this build has no Ceres.
void check_can_refine(const char* option);

/// Solves, for each channel,
///
///   log color = log exposure[photo] + log color[point]        gain in display sRGB, where the loss
///   is taken
///
/// by least squares with a Cauchy loss and a weak prior of exposure 1. The loss keeps the influence
/// of reflections, passers-by and wrong matches small. The geometric mean over the training photos
/// is 1. Test photos do not influence the others: their exposures are solved afterwards, from the
/// points' colors in training photos. The result does not depend on the number of threads.
/// `is_test` has one entry per photo. Only where can_refine().
ExposureFit fit_exposures(const std::vector<ColorSample>& samples,
                          const std::vector<bool>& is_test);

}  // namespace gs
