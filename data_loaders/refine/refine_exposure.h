// SPDX-License-Identifier: Apache-2.0
// How brightly and in which tint each photo was taken, from the colors that photos give to the points they share.
#pragma once

#include <vector>

#include "data_loaders/refine/color_samples.h"

namespace gs {

/// The exposures of all photos, and how well they explain the samples.
struct ExposureFit {
  std::vector<Vec3f> exposures;  // of each photo, per channel: the photo shows exposure * the scene's colors
  double spread_before = 0, spread_after = 0;  // of the colors of a point over photos, relative; robust
  std::size_t sample_count = 0;
  std::vector<std::size_t> unknown;  // photos with too few samples: 1 in every channel
};

/// Whether this build can refine anything: it has Ceres.
bool can_refine();

/// Throws Error that names what was asked for, where it cannot.
void check_can_refine(const char* option);

/// Solves, for each channel,
///
///   log color = log exposure[photo] + log color[point]        gain in display sRGB, where the loss is taken
///
/// in least squares with a Cauchy loss, so that reflections, passers-by and wrong matches count little, and a weak
/// prior of exposure 1. The geometric mean over photos that are not for testing is 1. Test photos have no influence on
/// the others: theirs are found afterwards, from the points' colors in training photos. The same on every number of threads.
/// `is_test` has one entry per photo. Only where can_refine().
ExposureFit fit_exposures(const std::vector<ColorSample>& samples,
                          const std::vector<bool>& is_test);

}  // namespace gs
