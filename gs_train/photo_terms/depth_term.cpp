// SPDX-License-Identifier: Apache-2.0
// Photos with a depth map: depths are blended beside the colors and compared with the map.
#include "gs_train/photo_terms/photo_term.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

class DepthTerm final : public PhotoTerm {
 public:
  void prepare(const TrainingModel&, StepPhoto& photo) override {
    photo.settings.blends_depth = photo.loss.depth_weight > 0 && !photo.view->depth.empty();
  }
  void show(const TrainingModel&, StepPhoto& photo, RenderPass& pass) override {
    if (!photo.settings.blends_depth || !(photo.loss.depth_weight > 0)) return;
    compare_depth(*photo.view, photo.loss.depth_weight, pass, dL_);
    photo.dL.depth = dL_.depth.span();
    photo.dL.alpha = dL_.alpha.span();
  }

 private:
  DepthGradient dL_;
};

}  // namespace

std::unique_ptr<PhotoTerm> make_depth_term(const std::shared_ptr<const PhotometricModel>&) {
  return std::make_unique<DepthTerm>();
}

}  // namespace gs
