// SPDX-License-Identifier: Apache-2.0
// Solves for the vignetting of each camera, from the colors that photos give to the points they
// share: a point that lies in the middle of one photo and at the rim of another tells.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <vector>

#include "data_loaders/refine/color_samples.h"

namespace gs {

/// The numbers b of log_vignetting() (gs_core/math/photometric.h), by View::camera_id.
using Lenses = std::map<std::uint32_t, std::array<float, 3>>;

/// Solves, for each channel, with exposures and colors as in fit_exposures(),
///
///   log color = log exposure[photo] - B(b[camera], rho) + log color[point]
///
/// and takes the mean b of the channels. Test photos do not take part. A weak prior holds b near 0,
/// and a lens that would be brighter at the corners than in the middle gets 0. The result does not
/// depend on the number of threads. Only where can_refine().
Lenses fit_vignetting(const std::vector<ColorSample>& samples, const std::vector<bool>& is_test);

/// The samples as lenses without vignetting would have given them.
std::vector<ColorSample> without_vignetting(std::vector<ColorSample> samples, const Lenses& lenses);

}  // namespace gs
