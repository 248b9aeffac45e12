// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "gs_train/photometric/photometric_model.h"

namespace gs {

/// "gains": a log gain for each photo and channel, and log vignetting for each camera.
std::unique_ptr<PhotometricModel> make_gains_model(const PhotometricConfig& config);

}  // namespace gs
