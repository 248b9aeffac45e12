// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "gs_train/photometric/photometric_model.h"

namespace gs {

inline constexpr const char* kPpispModel = "ppisp";

/// "ppisp": exposure and a color homography for each photo (math/ppisp.h), and log vignetting for
/// each camera. The response curve of PPISP (2026) is left out.
std::unique_ptr<PhotometricModel> make_ppisp_model(const PhotometricConfig& config);

}  // namespace gs
