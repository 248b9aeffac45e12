// SPDX-License-Identifier: Apache-2.0
// Tiles that a photo's mask leaves out have no list, and nothing else changes.

#include "gs_render/renderer.h"
#include "gs_render/stages.h"
#include "tests/support/lens_scenes.h"
#include "tests/support/test.h"

namespace gs {
namespace {

/// The circle of a fisheye that reaches the middles of the picture's sides.
Image8 circle(int side) {
  Image8 mask(side, side, 1, 0);
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x)
      if (std::hypot(x + 0.5 - side / 2.0, y + 0.5 - side / 2.0) < side / 2.0)
        mask.at(x, y, 0) = 255;
  return mask;
}

class MaskedTiles : public ::testing::TestWithParam<RenderSettings> {
 protected:
  static constexpr int kSide = 131;
  struct Pass {
    RenderPass pass;
    Gaussians gradients;
    Buffer<Vec2f> dL_dmean2d;
  };
  void draw(const RenderSettings& settings, Pass& to) const {
    renderer_->forward(gaussians_.span(), camera_, settings, to.pass);
    Buffer<float> dL;  // 0 where the mask is, as that of the loss
    dL.resize(3 * to.pass.pixel_count());
    Draws draws(5);
    for (std::size_t i = 0; i < dL.size(); ++i)
      dL[i] = draws.uniform(-1, 1) * float(mask_.pixels[i % to.pass.pixel_count()] > 0);
    to.gradients.resize(gaussians_.count());
    to.dL_dmean2d.resize(gaussians_.count());
    renderer_->backward(gaussians_.span(), camera_, settings, to.pass, dL.span(),
                        to.gradients.span(), to.dL_dmean2d.span());
  }

  bool has_pixel(std::size_t tile, const RenderPass& pass) const {
    const int left = int(tile) % pass.tiles_x * kTileWidth;
    const int top = int(tile) / pass.tiles_x * kTileHeight;
    for (int y = top; y < std::min(top + kTileHeight, kSide); ++y)
      for (int x = left; x < std::min(left + kTileWidth, kSide); ++x)
        if (mask_.at(x, y, 0) > 0) return true;
    return false;
  }

  const Camera camera_ =
      with_lens(random_camera(kSide, kSide, 1), CameraModel::simple_fisheye, {0.4, 0.5, 0.5});
  const Gaussians gaussians_ =
      at_angles(random_gaussians(kTypical, 2000, camera_, 2), camera_, 0, 2.6f, 3);
  const Image8 mask_ = circle(kSide);
  const std::unique_ptr<Renderer> renderer_ = make_scalar_renderer();
};

TEST_P(MaskedTiles, HaveNoListAndChangeNothingElse) {
  RenderSettings settings = GetParam();
  Pass whole, masked;
  draw(settings, whole);
  settings.mask = mask_.pixels.data();
  draw(settings, masked);
  const RenderPass &a = whole.pass, &b = masked.pass;
  std::size_t left_out = 0;
  for (std::size_t tile = 0; tile < a.tile_count(); ++tile) {
    const std::uint32_t before = a.tile_ranges[tile + 1] - a.tile_ranges[tile];
    const std::uint32_t length = b.tile_ranges[tile + 1] - b.tile_ranges[tile];
    EXPECT_EQ(length, has_pixel(tile, a) ? before : 0) << tile;
    left_out += length < before;
  }
  EXPECT_GT(left_out, 4u);
  EXPECT_LT(b.tile_splats.size(), a.tile_splats.size());
  const std::size_t plane = a.pixel_count();
  for (std::size_t i = 0; i < plane; ++i) {
    if (mask_.pixels[i] == 0) continue;
    for (std::size_t c = 0; c < 3; ++c) EXPECT_EQ(a.image[c * plane + i], b.image[c * plane + i]);
    EXPECT_EQ(a.transmittance[i], b.transmittance[i]);
  }
  const auto expect_equal = [&](const auto& x, const auto& y, std::size_t numbers) {
    const auto* const p = reinterpret_cast<const float*>(x.data());
    const auto* const q = reinterpret_cast<const float*>(y.data());
    for (std::size_t i = 0; i < numbers; ++i) ASSERT_EQ(p[i], q[i]) << i;
  };
  const std::size_t n = gaussians_.count();
  expect_equal(whole.gradients.mean, masked.gradients.mean, 3 * n);
  expect_equal(whole.gradients.log_scale, masked.gradients.log_scale, 3 * n);
  expect_equal(whole.gradients.rotation, masked.gradients.rotation, 4 * n);
  expect_equal(whole.gradients.logit_opacity, masked.gradients.logit_opacity, n);
  expect_equal(whole.gradients.sh0, masked.gradients.sh0, 3 * n);
  expect_equal(whole.dL_dmean2d, masked.dL_dmean2d, 2 * n);
  expect_equal(a.tile_counts, b.tile_counts, n);  // as visible as before
}

RenderSettings absolute_gradients() {
  RenderSettings settings;
  settings.absolute_gradient = true;
  return settings;
}
INSTANTIATE_TEST_SUITE_P(Settings, MaskedTiles,
                         ::testing::Values(RenderSettings(), absolute_gradients()),
                         [](const auto& of) { return of.index ? "absolute" : "plain"; });

}  // namespace
}  // namespace gs
