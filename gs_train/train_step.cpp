// SPDX-License-Identifier: Apache-2.0
#include "gs_train/train_step.h"

#include "gs_core/math/loss/area_filter.h"
#include "gs_train/reduced_view.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

// Tiles that the loss does not see need not be drawn. What is counted of fragments is counted
// everywhere, and a loss of the program sees the whole picture.
bool skips_masked_tiles(const StepStages& on, const StepPhoto& photo) {
  return photo.view->has_untrained_pixels() && !on.loss->sees_masked_pixels() &&
         photo.settings.fragment_statistic == FragmentStatistic::none;
}

}  // namespace

// The algorithm.   Kerbl et al. 2023, Eq. 3-7; Faster-GS, Sec. "Optimization"
void train_step(StepStages& on, TrainingModel& model, const TrainingStep& step) {
  const GaussiansSpan gaussians = model.gaussians.span();
  on.begin(model, step);
  for (const TrainingPhoto& given : step.photos) {
    StepPhoto photo = on.load(model, given, step.loss, step.density.fragment_statistic());
    if (skips_masked_tiles(on, photo)) photo.settings.mask = photo.view->mask.pixels.data();
    on.renderer->forward(gaussians, photo.camera, photo.settings, on.pass);     // 1-4
    for (const auto& term : on.terms) term->show(model, photo, on.pass);        // depth, gains
    on.loss->forward_backward(on.pass, *photo.view, photo.loss, on.dL_dimage);  // 5
    photo.dL.image = on.dL_dimage.span();
    if (on.loss->sees_depth()) on.loss->set_depth_gradient(photo.dL);
    on.renderer->backward(gaussians, photo.camera, photo.settings, on.pass,  // 6, 7
                          photo.dL, on.gradients.span(), on.dL_dmean2d.span());
    for (const auto& term : on.terms)  // gains, poses
      term->add_gradient(model, photo, on.pass, 1.0 / double(step.photos.size));
    on.add_photo(model, step);
  }
  on.update(model, step);  // 8
  for (const auto& term : on.terms) term->update(model, step.update);
}

StepStages::StepStages()
    : renderer(make_scalar_renderer()), loss(make_l1_ssim_loss()), terms(make_photo_terms(nullptr)),
      pass(host_memory()) {}

StepPhoto StepStages::load(const TrainingModel& model, const TrainingPhoto& photo,
                           const LossSettings& loss_settings, FragmentStatistic statistic) const {
  std::shared_ptr<const View> view = with_photo(*photo.view);
  if (photo.reduction > 1) view = std::make_shared<View>(reduced_view(*view, photo.reduction));
  StepPhoto loaded{photo, std::move(view), reduced(photo.view->camera, photo.reduction),
                   photo.settings, loss_settings};
  loaded.settings.fragment_statistic = statistic;
  if (loss->sees_depth()) loaded.loss.depth_weight = 0;
  for (const auto& term : terms) term->prepare(model, loaded);
  if (loss->sees_depth()) loaded.settings.blends_depth = true;
  return loaded;
}

void StepStages::begin(TrainingModel& model, const TrainingStep& step) {
  const auto prepare = [&](Gaussians& arrays) {
    arrays.has_time = model.gaussians.has_time;
    arrays.resize(model.count());
  };
  prepare(gradients);
  dL_dmean2d.resize(model.count());
  if (step.density.fragment_statistic() != FragmentStatistic::none) begin_sums(model);
  for (const auto& term : terms) term->begin(model, step.update);
  if (step.photos.size == 1) return;
  prepare(sum_);
  sum_.fill_zero();
  statistics_sum_.has_sums = model.statistics.has_sums;
  for (const Column& column : statistic_columns(statistics_sum_)) {
    column.rows->resize_discard(model.count());
    column.rows->fill_zero();
  }
}

void StepStages::add_photo(TrainingModel& model, const TrainingStep& step) {
  const bool is_summed = step.photos.size > 1;
  if (is_summed) add_weighted(gradients, 1.0f / float(step.photos.size), sum_);
  if (step.density.gather_statistics)
    gather_statistics(pass, dL_dmean2d.span(), is_summed ? statistics_sum_ : model.statistics);
}

void StepStages::update(TrainingModel& model, const TrainingStep& step) {
  const DensityStep& density = step.density;
  const bool is_summed = step.photos.size > 1;
  Gaussians& all = is_summed ? sum_ : gradients;
  if (density.regularizers.any()) regularize(model, density.regularizers, all);
  update_by_adam(model, all, step.update);
  if (density.noise.scale > 0) add_noise(model, density.noise, step.update.rates.mean);
  if (is_summed && density.gather_statistics) add_statistics(statistics_sum_, model.statistics);
}

void StepStages::release_caches() {
  pass = RenderPass(host_memory());
  dL_dimage.release();
  dL_dmean2d.release();
  gradients = Gaussians();
  sum_ = Gaussians();
  statistics_sum_ = DensityStatistics();
}

}  // namespace gs
