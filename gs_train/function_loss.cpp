// SPDX-License-Identifier: Apache-2.0
#include "gs_train/loss.h"

namespace gs {
namespace {

class FunctionLoss final : public Loss {
 public:
  FunctionLoss(OwnLoss own, Memory& memory, FindPhoto photo_of, std::function<void()> wait)
      : own_(std::move(own)), photo_of_(std::move(photo_of)), wait_(std::move(wait)),
        dL_dalpha_(memory), dL_ddepth_(memory) {}

  void forward_backward(const RenderPass& pass, const View& view, const LossSettings& settings,
                        Buffer<float>& dL_dimage) override {
    const Camera camera = reduced(view.camera, settings.photo_reduction);
    const PhotoBytes photo = photo_of_(view, settings.photo_reduction);
    dL_dimage.resize_discard(3 * pass.pixel_count());
    const float *transmittance = nullptr, *depth = nullptr;
    if (own_.sees_depth) {
      dL_dalpha_.resize_discard(pass.pixel_count());
      dL_ddepth_.resize_discard(pass.pixel_count());
      transmittance = pass.transmittance.data();
      depth = pass.depth_image.data();
    }
    value_ = own_.compare({view.name, camera, pass.image.data(), photo, dL_dimage.data(),
                           transmittance, depth, dL_dalpha_.data(), dL_ddepth_.data(), wait_});
  }
  double value() override { return own_.value ? own_.value() : value_; }
  bool sees_depth() const override { return own_.sees_depth; }
  bool sees_masked_pixels() const override { return true; }
  void set_depth_gradient(PictureGradient& dL) const override {
    dL.alpha = dL_dalpha_.span();
    dL.depth = dL_ddepth_.span();
  }

 private:
  const OwnLoss own_;
  const FindPhoto photo_of_;
  const std::function<void()> wait_;
  Buffer<float> dL_dalpha_, dL_ddepth_;  // (H, W)  empty unless it sees depth
  double value_ = 0;
};

}  // namespace

std::unique_ptr<Loss> make_function_loss(OwnLoss own, Memory& memory, FindPhoto photo_of,
                                         std::function<void()> wait) {
  return std::make_unique<FunctionLoss>(std::move(own), memory, std::move(photo_of),
                                        std::move(wait));
}

}  // namespace gs
