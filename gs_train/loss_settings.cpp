// SPDX-License-Identifier: Apache-2.0
#include "gs_train/loss_settings.h"

namespace gs {

LossSettings loss_settings(const Config& config) { return {config.loss.lambda_dssim}; }

}  // namespace gs
