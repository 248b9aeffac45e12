// SPDX-License-Identifier: Apache-2.0
// Photos with a depth map: depths are blended with the lists of the picture and compared with the
// map, and stage 6 adds what that leaves with the pass.
#include "gs_render/stages.h"
#include "gs_train/photo_terms/photo_term.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

class DepthTerm final : public PhotoTerm {
 public:
  void show(const TrainingModel&, StepPhoto& photo, RenderPass& pass) override {
    if (!(photo.loss.depth_weight > 0) || photo.view->depth.empty()) return;
    blend_depth(photo.settings, pass, planes_);
    compare_depth(*photo.view, photo.loss.depth_weight, planes_, dL_dplanes_);
    blend_depth_backward(photo.settings, dL_dplanes_.span(), planes_, pass);
  }

 private:
  Buffer<float> planes_, dL_dplanes_;
};

}  // namespace

std::unique_ptr<PhotoTerm> make_depth_term(const std::shared_ptr<const PhotometricModel>&) {
  return std::make_unique<DepthTerm>();
}

}  // namespace gs
