// SPDX-License-Identifier: Apache-2.0
// The order by pixel on the GPU, whose pixels sort within a window, against the scalar full sort.
#include "gs_train/features.h"
#include "tests/support/cuda.h"
#include "tests/support/lens_scenes.h"
#include "tests/support/scenes.h"

namespace gs {
namespace {

// Fragments within rounding of a threshold, depths that differ in the last seven bits only, and
// fragments beyond the window: this fraction of the pixels may differ.
constexpr double kElsewhere = 4e-3;
// of the norm of a gradient: the root of the fraction of pixels that really differ
constexpr double kGradients = 0.06;

struct OrderScene {
  const char* name;
  Gaussians gaussians;
  Camera camera;
  RenderSettings settings;
};

class CudaPixelOrder : public CudaTest {
 protected:
  std::vector<OrderScene> scenes() {
    std::vector<OrderScene> all;
    const auto add = [&](const char* name, const Recipe& recipe, int width, int height,
                         void (*change)(RenderSettings&)) {
      const Camera camera = random_camera(width, height, all.size() + 1);
      RenderSettings settings;
      settings.order = RenderOrder::pixel;
      change(settings);
      all.push_back(
          {name, random_gaussians(recipe, 2000, camera, all.size() + 10), camera, settings});
    };
    add("typical", kTypical, 160, 120, [](RenderSettings&) {});
    add("odd size, white", kTypical, 131, 77,
        [](RenderSettings& settings) { settings.background = Vec3f(1); });
    add("classic", kTypical, 160, 120,
        [](RenderSettings& settings) { settings.blend_rule = BlendRule::classic; });
    add("opaque, classic", kOpaque, 160, 120,
        [](RenderSettings& settings) { settings.blend_rule = BlendRule::classic; });
    add("opaque", kOpaque, 160, 120, [](RenderSettings&) {});
    add("antialias", kTypical, 160, 120,
        [](RenderSettings& settings) { settings.antialias = true; });
    add("sharp, sigma 3", kSharp, 160, 120,
        [](RenderSettings& settings) { settings.truncation = Truncation::sigma3; });
    add("more tiles than 16 bits number", kTypical, 6000, 3000, [](RenderSettings&) {});
    add("3D filter", kTypical, 131, 77, [](RenderSettings& settings) { settings.sh_degree = 1; });
    all.back().gaussians = with_filters(all.back().gaussians, 9);
    return all;
  }
};

TEST_F(CudaPixelOrder, PicturesAgree) {
  for (const OrderScene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    const Gaussians there = on_gpu(scene.gaussians);
    RenderPass here, pass(gpu().memory());
    cpu().renderer().forward(scene.gaussians.span(), scene.camera, scene.settings, here);
    const auto expected = here.image.download(), expected_T = here.transmittance.download();
    const std::size_t pixels = here.pixel_count();
    for (const bool for_backward : {true, false}) {
      RenderSettings settings = scene.settings;
      settings.for_backward = for_backward;
      gpu().renderer().forward(there.span(), scene.camera, settings, pass);
      const auto image = pass.image.download(), T = pass.transmittance.download();
      const auto blended = pass.last_instance.download(), all = here.last_instance.download();
      std::size_t differ = 0, T_differs = 0, counts_differ = 0;
      for (std::size_t i = 0; i < pixels; ++i) {
        double worst = 0;
        for (int c = 0; c < 3; ++c) {
          ASSERT_TRUE(std::isfinite(image[c * pixels + i]));
          worst =
              std::max<double>(worst, std::abs(image[c * pixels + i] - expected[c * pixels + i]));
        }
        differ += worst > 2e-4;
        T_differs += !(std::abs(T[i] - expected_T[i]) <= 2e-4f);
        counts_differ += blended[i] != all[i];
      }
      EXPECT_LE(double(differ), kElsewhere * double(pixels) + 1);
      EXPECT_LE(double(T_differs), kElsewhere * double(pixels) + 1);
      EXPECT_LE(double(counts_differ), 3 * kElsewhere * double(pixels) + 1);
    }
  }
}

TEST_F(CudaPixelOrder, GradientsAgree) {
  for (const OrderScene& scene : scenes()) {
    SCOPED_TRACE(scene.name);
    const Gaussians there = on_gpu(scene.gaussians);
    const std::size_t count = scene.gaussians.count();
    for (const bool with_depth : {false, true}) {
      RenderSettings settings = scene.settings;
      settings.blends_depth = with_depth;
      settings.absolute_gradient = with_depth;
      RenderPass here, pass(gpu().memory());
      cpu().renderer().forward(scene.gaussians.span(), scene.camera, settings, here);
      gpu().renderer().forward(there.span(), scene.camera, settings, pass);
      std::vector<float> dL(5 * here.pixel_count());
      Draws draws(99);
      for (float& value : dL) value = draws.normal();
      Buffer<float> cpu_dL, gpu_dL(gpu().memory());
      cpu_dL.upload(dL);
      gpu_dL.upload(dL);
      const auto gradient_of = [&](const Buffer<float>& all) {
        const std::size_t pixels = here.pixel_count();
        const float* const from = all.data();
        return with_depth ? PictureGradient({from, 3 * pixels}, {from + 3 * pixels, pixels},
                                            {from + 4 * pixels, pixels})
                          : PictureGradient(Span<const float>{from, 3 * pixels});
      };
      Gaussians expected(count, host_memory()), gradients(count, gpu().memory());
      Buffer<Vec2f> expected_mean2d(count, host_memory()), mean2d(count, gpu().memory());
      cpu().renderer().backward(scene.gaussians.span(), scene.camera, settings, here,
                                gradient_of(cpu_dL), expected.span(), expected_mean2d.span());
      // Twice, because a call must not leave anything behind.
      for (const bool deterministic : {false, false, true, true}) {
        settings.deterministic = deterministic;
        gpu().renderer().backward(there.span(), scene.camera, settings, pass, gradient_of(gpu_dL),
                                  gradients.span(), mean2d.span());
        EXPECT_LT(norm_difference(downloaded(mean2d), downloaded(expected_mean2d)), kGradients);
        for_each_array(
            [&](const char* name, const auto& a, const auto& b) {
              EXPECT_LT(norm_difference(downloaded(a), downloaded(b)), kGradients) << name;
            },
            gradients, expected);
      }
    }
  }
}

TEST_F(CudaPixelOrder, OfAModelThatIsDrawnManyTimesIsThatOfOnePicture) {
  OrderScene scene = std::move(scenes().front());
  scene.settings.for_backward = false;
  const Gaussians there = on_gpu(scene.gaussians);
  RenderPass once(gpu().memory()), pass(gpu().memory());
  gpu().renderer().forward(there.span(), scene.camera, scene.settings, once);
  const auto packed = gpu().renderer().pack(there.span(), scene.settings);
  for (int frame = 0; frame < 4; ++frame) {  // the third is launched by a forecast
    gpu().renderer().draw(*packed, scene.camera, scene.settings, pass);
    EXPECT_EQ(pass.image.download(), once.image.download()) << frame;
  }
  // A picture by z in between changes nothing, and is that of a fresh pass.
  RenderSettings by_z = scene.settings;
  by_z.order = RenderOrder::z;
  RenderPass fresh(gpu().memory());
  gpu().renderer().forward(there.span(), scene.camera, by_z, pass);
  gpu().renderer().forward(there.span(), scene.camera, by_z, fresh);
  EXPECT_EQ(pass.image.download(), fresh.image.download());
  EXPECT_NE(pass.image.download(), once.image.download());
  gpu().renderer().forward(there.span(), scene.camera, scene.settings, pass);
  EXPECT_EQ(pass.image.download(), once.image.download());
}

TEST_F(CudaPixelOrder, EmptyAndCoveredPicturesAreDrawn) {
  RenderSettings settings;
  settings.order = RenderOrder::pixel;
  settings.background = {0.25f, 0.5f, 0.75f};
  const Camera camera = plain_camera(300, 200);
  const auto expect_same = [&](const Gaussians& gaussians) {
    const Gaussians there = on_gpu(gaussians);
    RenderPass here, pass(gpu().memory());
    cpu().renderer().forward(gaussians.span(), camera, settings, here);
    gpu().renderer().forward(there.span(), camera, settings, pass);
    EXPECT_LT(norm_difference(pass.image.download(), here.image.download()), 2e-3);
  };
  expect_same(Gaussians(0, host_memory()));
  Gaussians many(100, host_memory());  // each covers every tile
  for (std::size_t i = 0; i < many.count(); ++i)
    set_gaussian(many, i, behind_pixel(camera, 150, 100, 2 + 0.01f * float(i)), 30, 0.05f);
  expect_same(many);
}

TEST_F(CudaPixelOrder, TrainingStepsAgree) {
  Config config = short_run();
  config.render.order = RenderOrder::pixel;
  config.train.iterations = 30;
  const Scene scene = small_scene();
  const auto loss_after = [&](Backend& backend) {
    Trainer trainer(scene, config, backend);
    trainer.run();
    return trainer.loss();
  };
  const double expected = loss_after(cpu());
  EXPECT_NEAR(loss_after(gpu()), expected, 0.03 * expected);
}

TEST_F(CudaPixelOrder, IsRefusedThroughLensesAndOnSeveralGpus) {
  RenderSettings settings;
  settings.order = RenderOrder::pixel;
  const Camera camera = random_camera(40, 30);
  const Gaussians there = on_gpu(random_gaussians(kTypical, 9, camera, 1));
  const LensScene& lens = lens_scenes()[0];
  RenderPass pass(gpu().memory());
  EXPECT_THROW(gpu().renderer().forward(there.span(), with_lens(camera, lens.model, lens.params),
                                        settings, pass),
               UsageError);
  Config config;
  config.render.order = RenderOrder::pixel;
  const std::unique_ptr<Backend> two = cuda::make_backend({0, 0});
  EXPECT_THROW(check_supported(config, two->features(), two->name()), UsageError);
  check_supported(config, gpu().features(), gpu().name());
}

}  // namespace
}  // namespace gs
