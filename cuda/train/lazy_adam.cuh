// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8 where SH is updated lazily (optimizer.lazy): what the files of the stage call of
// each other.
#pragma once

#include "cuda/stages.cuh"

namespace gs::cuda {

/// preprocess_backward_and_update() with settings.lazy_sh  preprocess_backward_lazy.cu
void update_lazily(Context& context, TrainingModel& model, const Camera& camera,
                   const RenderSettings& settings, const AdamSteps& steps, const AdamRule& rule,
                   const MomentRounding& rounding, const DensityStep& density, Workspace& workspace,
                   RenderPass& pass);

/// preprocess_backward_and_add() with settings.lazy_sh  preprocess_backward_lazy.cu
void add_lazily(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, const DensityStep& density, Workspace& workspace,
                RenderPass& pass, float weight, const BatchSums& sums);

}  // namespace gs::cuda
