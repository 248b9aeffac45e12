// SPDX-License-Identifier: Apache-2.0
#include "gs_train/backend.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/error.h"
#include "gs_core/math/loss/area_filter.h"
#include "gs_train/poses/poses.h"
#include "gs_train/reduced_view.h"

namespace gs {
namespace {

// Gives arrays the rows of a model.
void prepare(Gaussians& arrays, const TrainingModel& model) {
  arrays.has_time = model.gaussians.has_time;
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
  photometric_sum_.assign(photometric_ ? model.photometric.shape.size() : 0, 0.0);
  pose_sum_.assign(update.pose_rate > 0 ? model.poses.values.size() : 0, 0.0);
  for (const TrainingPhoto& photo : batch) {
    differentiate_photo(model, photo, loss_settings, density);
    if (!pose_sum_.empty()) add_camera_gradient(model, photo, 1.0 / double(batch.size));
    if (photometric_)
      add_photometric_gradient(model.photometric.shape, photo, 1.0 / double(batch.size));
    if (!is_summed) break;
    add(sum_, gradients_, 1.0f / float(batch.size));
    if (density.gather_statistics) gather(statistics_sum_, pass_, dL_dmean2d_.span());
  }
  Gaussians& gradients = is_summed ? sum_ : gradients_;
  if (density.regularizers.any()) optimizer().regularize(model, density.regularizers, gradients);
  optimizer().step(model, gradients, update);
  if (density.noise.scale > 0) optimizer().add_noise(model, density.noise, update.rates.mean);
  if (photometric_ && update.photometric_rate > 0)
    update_photometric(model.photometric, update, photometric_sum_);
  if (!pose_sum_.empty()) update_poses(model.poses, update.pose_rate, update.photo_rule, pose_sum_);
  if (!density.gather_statistics) return;
  if (is_summed)
    add(model.statistics, statistics_sum_);
  else
    gather(model.statistics, pass_, dL_dmean2d_.span());
}

void Backend::add(const Gaussians& to, const Gaussians& from, float weight) {
  for_each_array([&](const char*, auto& sums,
                     const auto& array) { add(numbers_of(sums), numbers_of(array), weight); },
                 to, from);
}

void Backend::add(const DensityStatistics& to, const DensityStatistics& from) {
  add(to.visits.span(), from.visits.span(), 1);
  add(to.gradient_norm.span(), from.gradient_norm.span(), 1);
  if (to.has_sums) add(to.sums.span(), from.sums.span());
}

void Backend::differentiate_photo(const TrainingModel& model, const TrainingPhoto& photo,
                                  const LossSettings& loss_settings, const DensityStep& density) {
  const GaussiansSpan gaussians = model.gaussians.span();
  const std::shared_ptr<const View> view = loaded_view(photo);
  const Camera camera = reduced(photo.camera(), photo.reduction);
  const RenderSettings settings = settings_of(photo, density);
  renderer().forward(gaussians, camera, settings, pass_);
  compare(model, photo, *view, loss_settings, density, pass_);
  renderer().backward(gaussians, camera, settings, pass_, dL_dimage_.span(), gradients_.span(),
                      dL_dmean2d_.span());
}

std::shared_ptr<const View> Backend::loaded_view(const TrainingPhoto& photo) {
  std::shared_ptr<const View> view = with_photo(*photo.view);
  if (photo.reduction > 1) view = std::make_shared<View>(reduced_view(*view, photo.reduction));
  return view;
}

RenderSettings Backend::settings_of(const TrainingPhoto& photo, const DensityStep& density) {
  RenderSettings settings = photo.settings;
  settings.fragment_statistic = density.fragment_statistic();
  return settings;
}

void Backend::compare(const TrainingModel& model, const TrainingPhoto& photo, const View& view,
                      const LossSettings& loss_settings, const DensityStep& density,
                      RenderPass& pass) {
  if (loss_settings.depth_weight > 0 && !view.depth.empty())
    compare_depth(view, settings_of(photo, density), loss_settings.depth_weight, pass);
  appearance_ = appearance_of(model, photo, view, pass);
  LossSettings of_photo = loss_settings;
  of_photo.appearance = appearance_.get();
  loss().forward_backward(pass, view, of_photo, dL_dimage_);
}

void Backend::score_photos(TrainingModel& model, Span<const TrainingPhoto> photos,
                           const PixelRule& rule) {
  begin_sums(model);
  model.statistics.sums.fill_zero();
  for (const TrainingPhoto& photo : photos) {
    const std::shared_ptr<const View> view = loaded_view(photo);
    renderer().forward(model.gaussians.span(), reduced(photo.camera(), photo.reduction),
                       photo.settings, pass_);
    appearance_ = appearance_of(model, photo, *view, pass_);
    add_pixel_scores(*view, photo.settings, rule, pass_, model.statistics.sums.span());
  }
}

void Backend::compare_depth(const View&, const RenderSettings&, float, RenderPass&) {
  GS_CHECK(false);  // of a backend that overrides step()
}

CameraGradient<double> Backend::camera_gradient(const GaussiansSpan&, const Camera&,
                                                const RenderSettings&, const RenderPass&) {
  GS_CHECK(false);  // of a backend that overrides step()
}

void Backend::add_camera_gradient(const TrainingModel& model, const TrainingPhoto& photo,
                                  double weight) {
  const CameraGradient<double> dL = camera_gradient(
      model.gaussians.span(), reduced(photo.camera(), photo.reduction), photo.settings, pass_);
  add_pose_gradient(model.poses, photo.photo_row, photo.view->camera, dL, weight, pose_sum_);
}

void Backend::check_takes_appearance(const Loss& loss, const std::string& kind) {
  if (!loss.takes_appearance())
    throw UsageError(fmt::format(
        "loss.kind {} does not know photometric.model; leave one of the two out", kind));
}

std::unique_ptr<Appearance> Backend::appearance_of(const TrainingModel& model,
                                                   const TrainingPhoto& photo, const View& view,
                                                   const RenderPass& pass) {
  if (!photometric_) return nullptr;
  const HostStage stage("photometric");
  auto appearance = photometric_->appearance(model.photometric.photo(photo.photo_row));
  appearance->show({pass.image.data(), pass.width, pass.height});
  if (view.over_background) appearance->show_background(pass.background, pass.width, pass.height);
  return appearance;
}

void Backend::add_photometric_gradient(const PhotometricShape& shape, const TrainingPhoto& photo,
                                       double weight) {
  const Span<const double> gradient = appearance_->gradient();
  double* const of_photo = photometric_sum_.data() + shape.photo_begin(photo.photo_row);
  for (std::size_t i = 0; i < gradient.size; ++i) of_photo[i] += weight * gradient[i];
}

void Backend::update_photometric(PhotometricState&, const Update&, std::vector<double>&) {
  GS_CHECK(false);  // of a backend that overrides step()
}

void Backend::prepare_sums(const TrainingModel& model) {
  prepare(sum_, model);
  sum_.fill_zero();
  statistics_sum_.has_sums = model.statistics.has_sums;
  for (const Column& column : statistic_columns(statistics_sum_)) {
    column.rows->resize_discard(model.count());
    column.rows->fill_zero();
  }
}

void Backend::release_caches() {
  release_pass();
  rows().release_caches();
}

void Backend::release_pass() {
  pass_ = RenderPass(pass_.image.memory());
  for (Buffer<float>* const planes : {&dL_dimage_, &depth_planes_, &dL_dplanes_}) planes->release();
  dL_dmean2d_.release();
  gradients_ = Gaussians(gradients_.memory());
  sum_ = Gaussians(sum_.memory());
  statistics_sum_ = DensityStatistics(sum_.memory());
}

}  // namespace gs
