// SPDX-License-Identifier: Apache-2.0
// What blend() and blend_backward() do in the order by pixel; they have sized the arrays.
#pragma once

#include "gs_render/stages.h"

namespace gs {

void blend_by_pixel(const RenderSettings& settings, RenderPass& pass);
void blend_backward_by_pixel(const RenderSettings& settings, const PictureGradient& dL,
                             RenderPass& pass);

}  // namespace gs
