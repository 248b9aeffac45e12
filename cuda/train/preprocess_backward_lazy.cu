// SPDX-License-Identifier: Apache-2.0
// Stages 7 and 8 where SH of some rows is late: visible rows catch up, others keep their SH and its
// moments as they are. They read and write 264 bytes of shape instead of 1,416.
#include "cuda/train/lazy_adam.cuh"
#include "cuda/train/preprocess_backward.cuh"

namespace gs::cuda {
namespace {

// A form of the moments: Numbers of shape and of color, which of() and of_color() make.
template <class Numbers, class ColorNumbers, class Of, class OfColor>
void launch_update(Context& context, const TrainingModel& model, const Camera& camera,
                   const RenderSettings& settings, const AdamSteps& steps,
                   const DensityStep& density, Workspace& workspace, RenderPass& pass, const Of& of,
                   const OfColor& of_color) {
  const GatherStatistics gather = gather_into(model.statistics, density, settings, pass, workspace);
  const UpdateAsAsked<Numbers, ColorNumbers> as_asked{
      update_of<UpdateAll<Numbers, ColorNumbers>>(model, steps, gather, of, of_color),
      density.gather_statistics && settings.absolute_gradient,
      density.regularizers.of_each(model.count())};
  const Lazily<UpdateAsAsked<Numbers, ColorNumbers>> sink{as_asked, lazy_colors(*settings.lazy_sh),
                                                          model.lazy.updated_at.data()};
  launch(context, model.gaussians.span(), camera, settings, workspace, pass, sink,
         slope_of<decltype(sink)>(model, steps, of_color));
}

}  // namespace

void update_lazily(Context& context, TrainingModel& model, const Camera& camera,
                   const RenderSettings& settings, const AdamSteps& steps, const AdamRule& rule,
                   const MomentRounding& rounding, const DensityStep& density, Workspace& workspace,
                   RenderPass& pass) {
  if (are_codes(model.moment_form))
    with_code(model.moment_form, [&]<class Code>(Code) {
      launch_update<AdamCodes<Code>, LazyAdamCodes<Code>>(
          context, model, camera, settings, steps, density, workspace, pass,
          codes_by<Code>(rule, rounding),
          [&](const auto& p, const auto&, const auto&, const auto& codes, const AdamStep& step,
              int place) {
            return LazyAdamCodes<Code>{{numbers_of(p), numbers_of(codes)}, step, rule, place};
          });
    });
  else
    launch_update<AdamNumbersByRule, LazyAdamNumbers>(
        context, model, camera, settings, steps, density, workspace, pass, floats_by(rule),
        [&](const auto& p, const auto& m, const auto& v, const auto&, const AdamStep& step, int) {
          return LazyAdamNumbers{{numbers_of(p), numbers_of(m), numbers_of(v)}, step, rule};
        });
}

void add_lazily(Context& context, const GaussiansSpan& gaussians, const Camera& camera,
                const RenderSettings& settings, const DensityStep& density, Workspace& workspace,
                RenderPass& pass, float weight, const BatchSums& sums) {
  const GaussiansSpan to = sums.gradients.span();
  const LazyColors lazy = lazy_colors(*settings.lazy_sh);
  const auto numbers = [weight](const auto& rows, const auto& sum) {
    return SumNumbers{{numbers_of(rows), numbers_of(sum)}, weight};
  };
  const auto color_numbers = [&](const auto& rows, const auto& sum, LazyQuantity quantity) {
    return LazySumNumbers{numbers(rows, sum), lazy.of[quantity]};
  };
  const AddGradients<LazySumNumbers> add{
      gather_into(sums.statistics, density, settings, pass, workspace),
      numbers(gaussians.mean, to.mean),
      numbers(gaussians.log_scale, to.log_scale),
      numbers(gaussians.rotation, to.rotation),
      numbers(gaussians.logit_opacity, to.logit_opacity),
      color_numbers(gaussians.sh0, to.sh0, kLazySh0),
      color_numbers(gaussians.sh_rest, to.sh_rest, kLazyShRest),
      numbers(gaussians.right_rotation, to.right_rotation),
      numbers(gaussians.time_mean, to.time_mean),
      numbers(gaussians.log_time_scale, to.log_time_scale),
      settings.absolute_gradient,
      sums.touched.data()};
  launch(context, gaussians, camera, settings, workspace, pass,
         Lazily<AddGradients<LazySumNumbers>>{add, lazy, nullptr},
         color_numbers(gaussians.sh0_slope, to.sh0_slope, kLazySh0Slope));
}

}  // namespace gs::cuda
