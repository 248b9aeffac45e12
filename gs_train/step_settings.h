// SPDX-License-Identifier: Apache-2.0
// What a Config says to the renderer and to the loss: its words ("sigma3") become values of enums
// here and nowhere else.
#pragma once

#include "gs_core/config/config.h"
#include "gs_render/render_pass.h"
#include "gs_train/loss.h"

namespace gs {

/// Render settings as the config states them, at the model's full SH degree. A random background is
/// black here; the trainer draws one for each step. Throws UsageError where a word is unknown.
RenderSettings render_settings(const Config& config);

/// The weights of the loss.
LossSettings loss_settings(const Config& config);

}  // namespace gs
