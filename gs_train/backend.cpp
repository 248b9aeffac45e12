// SPDX-License-Identifier: Apache-2.0
#include "gs_train/backend.h"

#include "gs_core/math/area_filter.h"
#include "gs_train/reduced_view.h"

namespace gs {
namespace {

// Gives arrays the rows of a model.
void prepare(Gaussians& arrays, const TrainingModel& model) {
  take_learned_arrays(arrays, model.gaussians);
  arrays.resize(model.count());
}

}  // namespace

void Backend::step(TrainingModel& model, Span<const TrainingPhoto> batch,
                   const LossSettings& loss_settings, const Update& update,
                   const DensityStep& density) {
  // A batch of several photos is summed up beside the model, so that nothing has changed where
  // memory runs out in one of them.
  const bool is_summed = batch.size > 1;
  prepare(gradients_, model);
  dL_dmean2d_.resize(model.count());
  if (density.fragment_statistic() != FragmentStatistic::none) begin_sums(model);
  if (is_summed) prepare_sums(model);
  for (const TrainingPhoto& photo : batch) {
    differentiate(model, photo, loss_settings, density);
    if (!is_summed) break;
    add(sum_, gradients_, 1.0f / float(batch.size));
    if (density.gather_statistics)
      gather(statistics_sum_, pass_, dL_dmean2d_.span(), density.pooling);
  }
  Gaussians& gradients = is_summed ? sum_ : gradients_;
  if (density.regularizers.any()) optimizer().regularize(model, density.regularizers, gradients);
  optimizer().step(model, gradients, update);
  if (density.noise.scale > 0) optimizer().add_noise(model, density.noise, update.rates.mean);
  if (!density.gather_statistics) return;
  if (is_summed)
    add(model.statistics, statistics_sum_, density.pooling);
  else
    gather(model.statistics, pass_, dL_dmean2d_.span(), density.pooling);
}

void Backend::add(const Gaussians& to, const Gaussians& from, float weight) {
  for_each_array([&](const char*, auto& sums,
                     const auto& array) { add(numbers_of(sums), numbers_of(array), weight); },
                 to, from);
}

void Backend::add(const DensityStatistics& to, const DensityStatistics& from,
                  ScorePooling pooling) {
  add(to.visits.span(), from.visits.span(), 1);
  add(to.gradient_norm.span(), from.gradient_norm.span(), 1);
  if (to.has_sums) pool(to.sums.span(), from.sums.span(), pooling);
}

// Renders a photo's view, compares it with the photo, and pulls the gradients back.
void Backend::differentiate(const TrainingModel& model, const TrainingPhoto& photo,
                            const LossSettings& loss_settings, const DensityStep& density) {
  const GaussiansSpan gaussians = model.gaussians.span();
  std::shared_ptr<const View> view = with_photo(*photo.view);
  if (photo.reduction > 1) view = std::make_shared<View>(reduced_view(*view, photo.reduction));
  const Camera camera = reduced(photo.view->camera, photo.reduction);
  RenderSettings settings = photo.settings;
  settings.fragment_statistic = density.fragment_statistic();
  renderer().forward(gaussians, camera, settings, pass_);
  loss().forward_backward(pass_, *view, loss_settings, dL_dimage_);
  if (settings.fragment_statistic != FragmentStatistic::none)
    find_pixel_values(*view, density, pass_);
  renderer().backward(gaussians, camera, settings, pass_, dL_dimage_.span(), gradients_.span(),
                      dL_dmean2d_.span());
}

void Backend::prepare_sums(const TrainingModel& model) {
  prepare(sum_, model);
  sum_.fill_zero();
  statistics_sum_.has_sums = model.statistics.has_sums;
  for_each_statistic(
      [&](const char*, auto& statistic) {
        statistic.resize_discard(model.count());
        statistic.fill_zero();
      },
      statistics_sum_);
}

void Backend::release_caches() {
  release_pass();
  rows().release_caches();
}

void Backend::release_pass() {
  pass_ = RenderPass(pass_.image.memory());
  dL_dimage_.release();
  dL_dmean2d_.release();
  gradients_ = Gaussians(gradients_.memory());
  sum_ = Gaussians(sum_.memory());
  statistics_sum_ = DensityStatistics(sum_.memory());
}

}  // namespace gs
