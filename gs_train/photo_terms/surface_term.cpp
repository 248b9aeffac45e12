// SPDX-License-Identifier: Apache-2.0
// Runs whose Gaussians lie on surfaces: these are blended beside the colors, and compared with
// themselves and with a neighboring photo.
#include "gs_train/photo_terms/photo_term.h"
#include "gs_train/reduced_view.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

class SurfaceTerm final : public PhotoTerm {
 public:
  void prepare(const TrainingModel&, StepPhoto& photo) override {
    photo.settings.blends_surface = photo.loss.surface.any();
  }
  void show(const TrainingModel&, StepPhoto& photo, RenderPass& pass) override {
    if (!photo.settings.blends_surface) return;
    compare_surface(*photo.view, neighbor_of(photo).get(), photo.loss.surface,
                    photo.given.patch_phase, pass, dL_);
    photo.dL.surface = dL_.sums.span();
  }

 private:
  static std::shared_ptr<const View> neighbor_of(const StepPhoto& photo) {
    if (!photo.given.neighbor || !(photo.loss.surface.photo > 0)) return nullptr;
    std::shared_ptr<const View> view = with_photo(*photo.given.neighbor);
    if (photo.given.reduction == 1) return view;
    return std::make_shared<View>(reduced_view(*view, photo.given.reduction));
  }
  SurfaceGradient dL_;
};

}  // namespace

std::unique_ptr<PhotoTerm> make_surface_term(const std::shared_ptr<const PhotometricModel>&) {
  return std::make_unique<SurfaceTerm>();
}

}  // namespace gs
