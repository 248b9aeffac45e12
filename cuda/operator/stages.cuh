// SPDX-License-Identifier: Apache-2.0
// What the operator has for itself: the first stage and the last one, between which are those of
// cuda/stages.cuh; and footprints by the rules of others.
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

/// footprints.cu: where Gaussians are by the rules of another rasterizer.
void footprints(Context& context, const OperatorInput& input, const SplatSettings& settings,
                const FootprintRule& rule, const OperatorFootprints& to);

}  // namespace gs::cuda
