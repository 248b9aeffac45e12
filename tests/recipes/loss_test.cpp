// SPDX-License-Identifier: Apache-2.0
// The recipe "a loss" of docs/develop/extending.md.
#include <gtest/gtest.h>

// [recipe]
#include "gs_core/math/constants.h"
#include "gs_train/loss.h"

namespace gs {
namespace {

/// The mean of (render - photo)^2 over all pixels and channels.
class SquaredLoss final : public Loss {
 public:
  void forward_backward(const RenderPass& pass, const View& view, const LossSettings&,
                        Buffer<float>& dL_dimage) override {
    const std::size_t pixels = std::size_t(pass.width) * pass.height, values = 3 * pixels;
    const std::shared_ptr<const View> loaded = with_photo(view);  // decodes it where needed
    dL_dimage.resize_discard(values);
    value_ = 0;
    for (std::size_t i = 0; i < values; ++i) {
      const std::size_t channel = i / pixels, pixel = i % pixels;  // planes in, pixels of bytes out
      const float difference =
          pass.image[i] - float(loaded->photo.pixels[3 * pixel + channel]) / 255.0f;
      dL_dimage[i] = 2 * difference / float(values);
      value_ += double(difference) * difference / double(values);
    }
  }
  double value() override { return value_; }

 private:
  double value_ = 0;
};

}  // namespace

std::unique_ptr<Loss> make_squared_loss() { return std::make_unique<SquaredLoss>(); }

}  // namespace gs
// [end]

namespace gs {
namespace {

TEST(RecipeLoss, IsZeroForThePhotoItselfAndItsGradientIsTheSlope) {
  View view;
  view.camera.width = 2;
  view.camera.height = 1;
  view.photo = Image8(2, 1, 3);
  RenderPass pass(host_memory());
  pass.width = 2;
  pass.height = 1;
  pass.image.resize_discard(6);
  for (float& value : pass.image) value = 0;
  const auto loss = make_squared_loss();
  Buffer<float> gradient(0, host_memory());
  loss->forward_backward(pass, view, {}, gradient);
  EXPECT_EQ(loss->value(), 0);
  pass.image[4] = 0.5f;
  loss->forward_backward(pass, view, {}, gradient);
  EXPECT_NEAR(loss->value(), 0.25 / 6, 1e-7);
  EXPECT_NEAR(gradient[4], 2 * 0.5f / 6, 1e-7f);
  EXPECT_EQ(gradient[0], 0);
}

}  // namespace
}  // namespace gs
