// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <numbers>

#include "gs_core/math/ppisp.h"
#include "gs_train/photometric/gains.h"
#include "gs_train/photometric/photometric_model.h"

namespace gs {

inline constexpr const char* kPpispModel = "ppisp";

inline constexpr std::size_t kPpispLatents = std::tuple_size_v<ColorLatents<float>>;
inline constexpr std::size_t kPpispNumbers = 1 + kPpispLatents;  // of a photo; first the exposure
// How far the numbers of a photo may be from solved ones before it costs much.
inline constexpr double kPpispExposureSpread = kGainPriorSpread / std::numbers::ln2;  // stops
inline constexpr double kPpispLatentSpread =
    1;  // latents have the spread that they have among cameras

/// "ppisp": exposure and a color homography for each photo (math/ppisp.h), and log vignetting for
/// each camera. The response curve of PPISP (2026) is left out.
std::unique_ptr<PhotometricModel> make_ppisp_model(const PhotometricConfig& config);

}  // namespace gs
