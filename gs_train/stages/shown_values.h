// SPDX-License-Identifier: Apache-2.0
// The rendered picture of a view as its photo shows it: under its exposure, or as a photometric
// model says. The loss and the pixel values of a score pass compare it with the photo.
#pragma once

#include "gs_core/math/loss/photo_weight.h"
#include "gs_core/scene.h"
#include "gs_render/render_pass.h"
#include "gs_train/photometric/appearance.h"

namespace gs {

/// View, pass and appearance outlive it. `appearance` may be null; else it has shown the picture,
/// and the background of a view over it.
class ShownValues {
 public:
  ShownValues(const View& view, const RenderPass& pass, const Appearance* appearance)
      : view_(view), pass_(pass), appearance_(appearance), plane_(pass.pixel_count()) {}

  /// (3, H, W), before the weights.
  const float* picture() const {
    return appearance_ ? appearance_->shown().data() : pass_.image.data();
  }
  /// The weights of channel c of pixel i, whose mask is m.
  PhotoWeight<float> weight(float m, int c, std::size_t i) const {
    if (!appearance_)
      return photo_weight(m, view_.exposure[c], pass_.background[c], view_.over_background);
    const float behind =
        view_.over_background ? appearance_->behind()[std::size_t(c) * plane_ + i] : 0.0f;
    return photo_weight(m, 1.0f, behind, view_.over_background);
  }
  float white() const { return appearance_ ? kPhotoWhite : view_.white(); }

 private:
  const View& view_;
  const RenderPass& pass_;
  const Appearance* appearance_;
  std::size_t plane_;
};

}  // namespace gs
