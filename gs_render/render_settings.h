// SPDX-License-Identifier: Apache-2.0
// From a config to the settings of the renderer.
#pragma once

#include "gs_core/config/config.h"
#include "gs_render/render_pass.h"

namespace gs {

/// The render settings of `config`: its [render] section, the model's SH degree,
/// train.deterministic and whether the method of density.strategy sums absolute gradients. The
/// background "random" is black here; the trainer draws another color for each step.
RenderSettings render_settings(const Config& config);

}  // namespace gs
