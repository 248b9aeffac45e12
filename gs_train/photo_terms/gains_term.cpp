// SPDX-License-Identifier: Apache-2.0
// Photos that differ in light: the picture is compared as the photometric model of the run shows it
// (gs_train/photometric).
#include "gs_render/stage_clock.h"
#include "gs_train/photo_terms/photo_term.h"

namespace gs {
namespace {

class GainsTerm final : public PhotoTerm {
 public:
  explicit GainsTerm(std::shared_ptr<const PhotometricModel> photometric)
      : photometric_(std::move(photometric)) {}

  void begin(const TrainingModel& model, const Update&) override {
    sum_.assign(photometric_ ? model.photometric.size() : 0, 0.0);
  }

  void show(const TrainingModel& model, StepPhoto& photo, RenderPass& pass) override {
    if (!photometric_) return;
    const HostStage stage("photometric");
    appearance_ = photometric_->appearance(model.photometric.row(photo.given.photo_row));
    appearance_->show({pass.image.data(), pass.width, pass.height});
    if (photo.view->over_background)
      appearance_->show_background(pass.background, pass.width, pass.height);
    photo.loss.appearance = appearance_.get();
  }

  void add_gradient(const TrainingModel& model, const StepPhoto& photo, const RenderPass&,
                    double weight) override {
    if (!photometric_) return;
    const Span<const double> gradient = appearance_->gradient();
    double* const of_photo = sum_.data() + model.photometric.begin_of(photo.given.photo_row);
    for (std::size_t i = 0; i < gradient.size; ++i) of_photo[i] += weight * gradient[i];
  }

  void update(TrainingModel& model, const Update& update) override {
    if (!photometric_ || !(update.photometric_rate > 0)) return;
    const HostStage stage("photometric");
    PhotometricState& state = model.photometric;
    update_table(state, photometric_->pulls(state), update.photometric_rate, update.photo_rule,
                 sum_);
  }

 private:
  const std::shared_ptr<const PhotometricModel> photometric_;  // null: none
  std::unique_ptr<Appearance> appearance_;                     // of the last photo
  std::vector<double> sum_;                                    // dL/d(numbers of all photos)
};

}  // namespace

std::unique_ptr<PhotoTerm> make_gains_term(
    const std::shared_ptr<const PhotometricModel>& photometric) {
  return std::make_unique<GainsTerm>(photometric);
}

}  // namespace gs
