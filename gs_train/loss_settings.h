// SPDX-License-Identifier: Apache-2.0
// The part of a Config that the loss needs.
#pragma once

#include "gs_core/config/config.h"
#include "gs_train/loss.h"

namespace gs {

/// The weights of the loss.
LossSettings loss_settings(const Config& config);

}  // namespace gs
