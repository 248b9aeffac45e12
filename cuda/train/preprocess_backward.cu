// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8: the three uses of the kernel of preprocess_backward.cuh.
#include "cuda/train/preprocess_backward.cuh"

namespace gs::cuda {

void preprocess_backward(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                         const RenderSettings& settings, Workspace& workspace, RenderPass& pass,
                         const GaussiansSpan& gradients, Span<Vec2f> dL_dmean2d) {
  const StageScope scope(context, "preprocess backward");
  if (settings.sh_degree < kMaxShDegree && gradients.sh_rest.size)  // degrees not in use have none
    check(cudaMemsetAsync(gradients.sh_rest.data, 0, gradients.sh_rest.size * sizeof(ShRest),
                          context.stream()),
          "preprocess backward");
  const auto numbers = [](const auto& rows, const auto& to) {
    return GradientNumbers{{numbers_of(rows)}, numbers_of(to)};
  };
  const WriteGradients sink{numbers(gaussians.mean, gradients.mean),
                            numbers(gaussians.log_scale, gradients.log_scale),
                            numbers(gaussians.rotation, gradients.rotation),
                            numbers(gaussians.logit_opacity, gradients.logit_opacity),
                            numbers(gaussians.sh0, gradients.sh0),
                            numbers(gaussians.sh_rest, gradients.sh_rest),
                            numbers(gaussians.right_rotation, gradients.right_rotation),
                            numbers(gaussians.time_mean, gradients.time_mean),
                            numbers(gaussians.log_time_scale, gradients.log_time_scale),
                            dL_dmean2d.data,
                            settings.absolute_gradient};
  launch(context, gaussians, camera, settings, workspace, pass, sink);
}

void preprocess_backward_and_add(Context& context, const GaussiansSpan& gaussians,
                                 const Camera& camera, const RenderSettings& settings,
                                 const DensityStep& density, Workspace& workspace, RenderPass& pass,
                                 float weight, const BatchSums& sums, const DevicePose* pose,
                                 const Shard& shard) {
  const StageScope scope(context, "preprocess backward");
  const GaussiansSpan to = sums.gradients.span();
  const auto numbers = [weight](const auto& rows, const auto& sum) {
    return SumNumbers{{numbers_of(rows), numbers_of(sum)}, weight};
  };
  const AddGradients sink{gather_into(sums.statistics, density, settings, pass, workspace, shard),
                          numbers(gaussians.mean, to.mean),
                          numbers(gaussians.log_scale, to.log_scale),
                          numbers(gaussians.rotation, to.rotation),
                          numbers(gaussians.logit_opacity, to.logit_opacity),
                          numbers(gaussians.sh0, to.sh0),
                          numbers(gaussians.sh_rest, to.sh_rest),
                          numbers(gaussians.right_rotation, to.right_rotation),
                          numbers(gaussians.time_mean, to.time_mean),
                          numbers(gaussians.log_time_scale, to.log_time_scale),
                          settings.absolute_gradient,
                          sums.touched.data()};
  launch(context, gaussians, camera, settings, workspace, pass, sink, pose, shard);
}

void preprocess_backward_and_update(Context& context, TrainingModel& model, const Camera& camera,
                                    const RenderSettings& settings, const AdamSteps& steps,
                                    const AdamRule& rule, const MomentRounding& rounding,
                                    const DensityStep& density, Workspace& workspace,
                                    RenderPass& pass, const DevicePose* pose, const Shard& shard) {
  const StageScope scope(context, "preprocess backward, Adam");
  const GaussiansSpan rows = model.gaussians.span();
  const GatherStatistics gather =
      gather_into(model.statistics, density, settings, pass, workspace, shard);
  with_update(model, steps, rule, rounding, density, settings, gather, shard,
              [&](const auto& sink) {
                launch(context, rows, camera, settings, workspace, pass, sink, pose, shard);
              });
}

}  // namespace gs::cuda
