// SPDX-License-Identifier: Apache-2.0
// The stages that the operator has for itself: the first one and the last one. Those between them
// are in cuda/stages.cuh.
#pragma once

#include <limits>

#include "cuda/stages.cuh"
#include "gs_render/operator.h"

namespace gs::cuda {

/// RenderPass::least_color: colors that are given are used as they are.
inline float least_color(const OperatorInput& input) {
  return input.arrays.colors.data ? -std::numeric_limits<float>::infinity() : 0.0f;
}

/// 1  project.cu: one splat per Gaussian, and which tiles it hits.
void project(Context& context, const OperatorInput& input, const RenderSettings& settings,
             Workspace& workspace, RenderPass& pass);

/// 7  project_backward.cu: from workspace.splat_gradients to the gradients of what was given. The
/// sums stay as they are. Where `overflowed`, which may be null, is raised, gradients are zero.
void project_backward(Context& context, const OperatorInput& input, const RenderSettings& settings,
                      Workspace& workspace, const RenderPass& pass, const std::uint32_t* overflowed,
                      const OperatorGradients& gradients);

}  // namespace gs::cuda
