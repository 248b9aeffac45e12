// SPDX-License-Identifier: Apache-2.0
// Means under the 11x11 Gaussian window of SSIM, for a stack of planes.
#pragma once

#include "gs_core/buffer.h"

namespace gs {

/// Replaces each of the `planes` planes of `width` x `height` values by its windowed means. Values
/// outside a plane are 0. `scratch` grows to the same size.
void window_means(Span<float> stack, int planes, int width, int height, Buffer<float>& scratch);

}  // namespace gs
