// SPDX-License-Identifier: Apache-2.0
// Stage 4 on tensor cores against blend.cu, from the same lists: the picture, the transmittance,
// and the last fragment of each pixel.
#include "tests/support/cuda.h"
#include "tests/support/frames.h"

namespace gs {
namespace {

// A fragment within rounding of a threshold may be kept by one kernel and dropped by the other.
// This fraction of all numbers may differ because of it.
constexpr double kBorderline = 1e-3;

// The change that one kept or dropped fragment can cause; the end of a pixel causes less.
constexpr double kOneFragment = 0.05;

// PSNR between two pictures in dB, without the few numbers that differ most; none of these may
// differ by more than one fragment.
double psnr(const std::vector<float>& a, const std::vector<float>& b) {
  for (std::size_t i = 0; i < a.size(); ++i)
    if (!(std::abs(double(a[i]) - b[i]) < kOneFragment))
      return -std::numeric_limits<double>::infinity();
  return psnr_of_most(a, b, kBorderline);
}

struct Pictures {
  std::vector<float> image, transmittance;
  std::vector<std::uint32_t> last;
};

class CudaBlendGemm : public CudaTest {
 protected:
  Pictures render(const Gaussians& gaussians, const Camera& camera,
                  const RenderSettings& settings) {
    const Gaussians on_gpu =
        copy_to(gpu().memory(), GaussianModel{copy_of(gaussians), kMaxShDegree, true, false});
    RenderPass pass(gpu().memory());
    gpu().renderer().forward(on_gpu.span(), camera, settings, pass);
    return {pass.image.download(), pass.transmittance.download(), pass.last_instance.download()};
  }
  Pictures simt(const Gaussians& gaussians, const Camera& camera, RenderSettings settings) {
    settings.use_tensor_cores = false;
    return render(gaussians, camera, settings);
  }

  void expect_same(const Gaussians& gaussians, const Camera& camera, RenderSettings settings = {}) {
    constexpr double decibels = 100;
    settings.background = {0.25f, 0.5f, 0.75f};
    const Pictures a = render(gaussians, camera, settings), b = simt(gaussians, camera, settings);
    EXPECT_GT(psnr(a.image, b.image), decibels);
    const std::size_t pixels = a.last.size();
    std::size_t T_differs = 0, last_differs = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      T_differs += !(std::abs(a.transmittance[i] - b.transmittance[i]) <= 1e-5f);
      last_differs += a.last[i] != b.last[i];
    }
    EXPECT_LE(double(T_differs), kBorderline * double(pixels) + 1);
    EXPECT_LE(double(last_differs), kBorderline * double(pixels) + 1);
    // Pictures for viewing lack the arrays that the backward pass reads.
    settings.for_backward = false;
    EXPECT_GT(psnr(render(gaussians, camera, settings).image, b.image), decibels);
  }
};

TEST_F(CudaBlendGemm, RandomScenes) {
  const Camera small = random_camera(160, 120, 3), large = random_camera(1300, 900, 4);
  RenderSettings classic, antialias, box, square;
  classic.blend_rule = BlendRule::classic;
  antialias.antialias = true;
  box.bounds = TileBounds::box;
  square.bounds = TileBounds::square;
  int seed = 20;
  for (const Camera& camera : {small, large})
    for (const Recipe& recipe : {kTypical, kSharp, kHuge, kFaint, kOpaque, kNegativeColors}) {
      SCOPED_TRACE(seed);
      const Gaussians gaussians = random_gaussians(recipe, 3000, camera, ++seed);
      expect_same(gaussians, camera);
      expect_same(gaussians, camera, classic);
      expect_same(gaussians, camera, antialias);
      expect_same(gaussians, camera, box);
      expect_same(gaussians, camera, square);
    }
}

TEST_F(CudaBlendGemm, Needles) {
  for (const Camera& camera : {random_camera(640, 480, 5), random_camera(1300, 900, 6)})
    for (const TileBounds bounds : {TileBounds::exact, TileBounds::box, TileBounds::square}) {
      RenderSettings settings;
      settings.bounds = bounds;
      expect_same(random_gaussians(kNeedles, 3000, camera, 6), camera, settings);
    }
}

// Rounding must not raise a fragment above its opacity and thereby drop it: each splat is visible
// at its own center.
TEST_F(CudaBlendGemm, NoFragmentIsLostAtItsCenter) {
  const Camera camera = plain_camera(64, 48);
  for (const float opacity : {0.9999f, 0.99f, 0.5f, 1.0f / 254}) {
    Gaussians one(1, host_memory());
    set_gaussian(one, 0, behind_pixel(camera, 21.5f, 17.5f, 2), 0.01f, opacity, {1, 1, 1});
    const Pictures a = render(one, camera, {});
    EXPECT_NEAR(a.image[17 * 64 + 21], opacity, 1e-4f);
    expect_same(one, camera);
  }
}

// (1 - 0.99)^2 is exactly the threshold.
TEST_F(CudaBlendGemm, TwoOpaqueSplatsEndAPixelAlike) {
  const Camera camera = plain_camera(64, 48);
  Gaussians layers(6, host_memory());
  for (std::size_t i = 0; i < layers.count(); ++i)
    set_gaussian(layers, i, behind_pixel(camera, 32, 24, 2 + 0.1f * float(i)), 5, 0.9999f,
                 {float(i % 2), float(i % 3) / 2, 1});
  RenderSettings classic;
  classic.blend_rule = BlendRule::classic;
  expect_same(layers, camera, classic);
  expect_same(layers, camera);
}

// The alpha of an opaque splat may be rounded to more than 1. Its pixels end there all the same.
TEST_F(CudaBlendGemm, AlphasThatAreRoundedAboveOneEndPixels) {
  const Camera camera = plain_camera(96, 80);
  for (const float opacity : {0.9999999f, 0.999999f}) {
    Gaussians layers(80, host_memory());
    for (std::size_t i = 0; i < layers.count(); ++i)
      set_gaussian(
          layers, i,
          behind_pixel(camera, float(7 * i % 96), float(11 * i % 80), 2 + 0.01f * float(i)),
          i % 2 ? 0.02f : 8, opacity, {float(i % 2), float(i % 3) / 2, 1});
    expect_same(layers, camera);
    for (const float T : render(layers, camera, {}).transmittance) {
      EXPECT_GE(T, 0);
      EXPECT_LT(T, 2 * kMinTransmittance);
    }
  }
}

// Lists whose length is not a multiple of a batch, lists longer than a segment, and empty ones;
// tiles that lie partly outside of the picture.
TEST_F(CudaBlendGemm, ListsOfAnyLength) {
  for (const int side : {1, 7, 15, 16, 17, 33}) {
    const Camera camera = plain_camera(side, 49 - side);
    for (const std::size_t count : {0, 1, 31, 32, 33, 64, 100, 511, 512, 513, 1100}) {
      SCOPED_TRACE(count);
      Gaussians layers(count, host_memory());
      for (std::size_t i = 0; i < count; ++i)
        set_gaussian(layers, i,
                     behind_pixel(camera, float(i % 5) * 0.2f * float(side), float(i % 7),
                                  2 + 0.01f * float(i)),
                     0.5f, 0.01f, {float(i % 3) / 2, float(i % 5) / 4, float(i % 7) / 6});
      expect_same(layers, camera);
    }
  }
}

// The backward pass reads results of the forward pass: gradients must not depend on which kernel
// blended.
TEST_F(CudaBlendGemm, GradientsAgree) {
  const Camera camera = random_camera(160, 120, 3);
  for (const Recipe& recipe : {kTypical, kOpaque, kFaint}) {
    const Gaussians gaussians = random_gaussians(recipe, 3000, camera, 8);
    const Gaussians on_gpu =
        copy_to(gpu().memory(), GaussianModel{copy_of(gaussians), kMaxShDegree, true, false});
    std::vector<std::vector<float>> by_mean;
    for (const bool use_tensor_cores : {true, false}) {
      RenderSettings settings;
      settings.use_tensor_cores = use_tensor_cores;
      RenderPass pass(gpu().memory());
      gpu().renderer().forward(on_gpu.span(), camera, settings, pass);
      std::vector<float> ones(pass.image.size());
      Draws draws(5);
      for (float& value : ones) value = draws.normal();
      Buffer<float> dL(gpu().memory());
      dL.upload(ones);
      Gaussians gradients(gaussians.count(), gpu().memory());
      Buffer<Vec2f> by_mean2d(gaussians.count(), gpu().memory());
      gpu().renderer().backward(on_gpu.span(), camera, settings, pass, dL.span(), gradients.span(),
                                by_mean2d.span());
      by_mean.push_back(downloaded(gradients.mean));
    }
    EXPECT_LT(norm_difference(by_mean[0], by_mean[1]), 1e-3);
  }
}

}  // namespace
}  // namespace gs
