// SPDX-License-Identifier: Apache-2.0
// The scalar CPU backend: the contracts in their simplest form.
#include "gs_train/stages/scalar_backend.h"

#include "gs_render/stages.h"
#include "gs_train/named_row.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

struct LossRow {
  const char* name;  // a word of loss.kind
  std::unique_ptr<Loss> (*make)();
};
constexpr LossRow kLosses[] = {{"l1_ssim", make_l1_ssim_loss}};

PhotoBytes photo_of_reduced_view(const View& view, int) {
  return {view.photo.pixels.data(), view.mask.empty() ? nullptr : view.mask.pixels.data()};
}

}  // namespace

ScalarBackend::ScalarBackend()
    : Backend({names_of(kLosses), photometric_models()}), rows_(make_scalar_row_ops()) {}

void ScalarBackend::use(const RunChoices& choices) {
  const std::string name = choices.own_loss.compare ? "" : choices.loss;
  if (choices.own_loss.compare)
    on_.loss = make_function_loss(choices.own_loss, host_memory(), photo_of_reduced_view, [] {});
  else if (loss_name_ != name)
    on_.loss = row_named(kLosses, name, "loss.kind")->make();
  loss_name_ = name;
  on_.terms = make_photo_terms(choices.photometric);
}

void ScalarBackend::score_photos(TrainingModel& model, Span<const TrainingPhoto> photos,
                                 const PixelRule& rule) {
  begin_sums(model);
  model.statistics.sums.fill_zero();
  for (const TrainingPhoto& given : photos) {
    StepPhoto photo = on_.load(model, given, {}, FragmentStatistic::none);
    on_.renderer->forward(model.gaussians.span(), photo.camera, photo.settings, on_.pass);
    for (const auto& term : on_.terms) term->show(model, photo, on_.pass);
    find_pixel_values(*photo.view, rule, on_.pass, photo.loss.appearance, pixel_values_);
    blend_values(photo.settings, pixel_values_.span(), on_.pass);
    add_fragment_sums(on_.pass, model.statistics.sums.span());
  }
}

void ScalarBackend::release_caches() {
  on_.release_caches();
  rows_->release_caches();
}

std::unique_ptr<Backend> make_scalar_backend() { return std::make_unique<ScalarBackend>(); }

}  // namespace gs
