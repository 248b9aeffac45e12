// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "gs_train/photometric/photometric_model.h"

namespace gs {

// Weights in the loss, whose data term is a mean over pixels. Chosen so that they decide only where
// the photos say little.
inline constexpr double kGainPriorWeight = 0.01;
inline constexpr double kGainPriorSpread = 0.5;  // of log gains, as in refine_exposure.cpp

inline constexpr const char* kGainsModel = "gains";

/// "gains": a log gain for each photo and channel.
std::unique_ptr<PhotometricModel> make_gains_model();

}  // namespace gs
