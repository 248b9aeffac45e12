// SPDX-License-Identifier: Apache-2.0
// What frames of a packed model leave with their RenderPass on the GPU. Host code can read it, as
// tests do.
#pragma once

#include "gs_core/math/view_splat.h"
#include "gs_render/render_pass.h"

namespace gs::cuda {

// clang-format off
/// The scratch of frames of a packed model.
struct ViewScratch : BackendScratch {
  bool has_view_splats = false;         // stage 1 has filled view_splats in place of pass.splats
  Buffer<ViewSplat> view_splats;        // (N)

  explicit ViewScratch(Memory& memory) : view_splats(memory) {}
};
// clang-format on

}  // namespace gs::cuda
