// SPDX-License-Identifier: Apache-2.0
// The order by pixel: pictures and gradients against brute force that sorts each pixel, and what the
// order is for: Gaussians that penetrate each other, and a camera that turns in place.
#include "gs_render/renderer.h"
#include "gs_render/stages.h"
#include "tests/stages/slopes.h"

namespace gs {
namespace {

constexpr double kTolerance = 2e-5;  // of colors: that of the order by z in render_test.cpp

RenderSettings by_pixel() {
  RenderSettings settings;
  settings.order = RenderOrder::pixel;
  return settings;
}

RenderPass render(const Gaussians& gaussians, const Camera& camera,
                  const RenderSettings& settings) {
  RenderPass pass;
  make_scalar_renderer()->forward(gaussians.span(), camera, settings, pass);
  return pass;
}

Vec3f color_at(const RenderPass& pass, int x, int y) {
  const std::size_t i = std::size_t(y) * pass.width + x, plane = pass.pixel_count();
  return {pass.image[i], pass.image[plane + i], pass.image[2 * plane + i]};
}

TEST(PixelOrder, PicturesAreThoseOfAFullSortOfEachPixel) {
  const Camera camera = random_camera(70, 50, 4);
  for (const BlendRule rule : {BlendRule::faster_gs, BlendRule::classic})
    for (const Recipe& recipe : {kTypical, kOpaque, kHuge, kSharp}) {
      RenderSettings settings = by_pixel();
      settings.blend_rule = rule;
      settings.background = {0.2f, 0.5f, 0.8f};
      const Gaussians gaussians = random_gaussians(recipe, 200, camera, 9);
      const RenderPass pass = render(gaussians, camera, settings);
      const ReferencePicture expected = reference_picture(
          reference_splats<float>(in_double(gaussians), camera, settings), settings, 70, 50);
      std::size_t doubtful = 0, wrong = 0;
      for (std::size_t i = 0; i < pass.pixel_count(); ++i) {
        const ReferencePixel& pixel = expected.pixels[i];
        if (pixel.is_doubtful) {
          ++doubtful;
          continue;
        }
        double worst = std::abs(pass.transmittance[i] - pixel.transmittance);
        for (int c = 0; c < 3; ++c)
          worst = std::max(
              worst, std::abs(double(pass.image[c * pass.pixel_count() + i]) - pixel.color[c]));
        wrong += !(worst < kTolerance);
      }
      EXPECT_LE(wrong, 4u);  // depths that are equal to the last digits
      EXPECT_LT(doubtful, pass.pixel_count() / 10);
    }
}

TEST(PixelOrder, GradientsAreTheSlopes) {
  for (const SceneChange& change : kSceneChanges) {
    Camera camera = slope_camera();
    RenderSettings settings = by_pixel();
    Gaussians gaussians = random_gaussians(kTypical, 9, camera, 21);
    change.apply(camera, settings, gaussians);
    if (gaussians.has_time || camera.has_lens()) continue;
    SCOPED_TRACE(change.name);
    const std::vector<float> weights = loss_weights(1);
    const std::unique_ptr<Renderer> renderer = make_scalar_renderer();
    RenderPass pass;
    Gaussians gradients(gaussians.count(), host_memory());
    Buffer<Vec2f> dL_dmean2d(gaussians.count(), host_memory());
    renderer->forward(gaussians.span(), camera, settings, pass);
    renderer->backward(gaussians.span(), camera, settings, pass, uploaded(weights).span(),
                       gradients.span(), dL_dmean2d.span());
    expect_slopes(gaussians, gradients, {2e-5, 3e-5, 0.02},
                  [&](const std::vector<DoubleGaussian>& moved, std::uint64_t& decisions) {
                    const ReferencePicture picture =
                        reference_picture(reference_splats<double>(moved, camera, settings),
                                          settings, kWidth, kHeight);
                    decisions = picture.decisions();
                    return linear_loss(weights, picture.planes());
                  });
  }
}

// What density control and depth maps ask of the backward pass does not depend on the order where
// Gaussians are far apart in depth.
TEST(PixelOrder, SumsBesideTheGradientsAreThoseOfTheOrderByZ) {
  const Camera camera = random_camera(60, 40, 6);
  Gaussians gaussians(20, host_memory());
  for (std::size_t i = 0; i < gaussians.count(); ++i)
    set_gaussian(gaussians, i, behind_pixel(camera, 3.0f * float(i), 20, 1 + float(i)), 0.05f,
                 0.5f);
  RenderSettings settings = by_pixel();
  settings.absolute_gradient = settings.blends_depth = true;
  settings.fragment_statistic = FragmentStatistic::force;
  std::vector<float> dL(4 * 60 * 40);
  Draws draws(3);
  for (float& value : dL) value = draws.uniform(-1, 1);
  const Span<const float> by_image{dL.data(), 3 * 60 * 40},
      by_depth{dL.data() + 3 * 60 * 40, 60 * 40};
  std::vector<RenderPass> passes(2);
  for (RenderPass& pass : passes) {
    preprocess(gaussians.span(), camera, settings, pass);
    create_instances(settings, pass);
    sort_by_tile(pass);
    blend(settings, pass);
    blend_backward(settings, {by_image, {}, by_depth}, pass);
    settings.order = RenderOrder::z;
  }
  const auto near = [](float a, float b) { return std::abs(a - b) <= 1e-4f * std::abs(b) + 1e-5f; };
  for (std::size_t i = 0; i < gaussians.count(); ++i) {
    if (passes[0].tile_counts[i] == 0) continue;
    const SplatGradient a = splat_gradient_of(passes[0], i), b = splat_gradient_of(passes[1], i);
    EXPECT_TRUE(near(a.opacity, b.opacity) && near(a.depth, b.depth)) << i;
    const Vec2f by_pixel = absolute_gradient_of(passes[0], i),
                by_z = absolute_gradient_of(passes[1], i);
    EXPECT_TRUE(near(by_pixel.x, by_z.x) && near(by_pixel.y, by_z.y)) << i;
    const FragmentSums sums = fragment_sums_of(passes[0], i),
                       expected = fragment_sums_of(passes[1], i);
    EXPECT_EQ(sums.count, expected.count) << i;
    EXPECT_TRUE(std::abs(sums.second - expected.second) <= 1e-3f * expected.second) << i;
  }
}

// A red and a green disk that cross in a vertical line through the middle of the picture.
Gaussians crossing_disks() {
  Gaussians disks(2, host_memory());
  const Vec3f colors[] = {{1, 0, 0}, {0, 1, 0}};
  for (std::size_t i = 0; i < 2; ++i) {
    set_gaussian(disks, i, {0, 0, 4.0f + 0.01f * float(i)}, 1, 0.999f, colors[i]);
    disks.log_scale[i].z = std::log(0.01f);
    disks.rotation[i] = {1, 0, i == 0 ? 0.4f : -0.4f, 0};  // about the vertical axis
  }
  return disks;
}

TEST(PixelOrder, OfTwoDisksThatCrossEachIsInFrontOnItsSide) {
  Camera camera = plain_camera(64, 64);
  camera.cx = camera.cy = 32;
  const RenderPass z = render(crossing_disks(), camera, {});
  const RenderPass pixel = render(crossing_disks(), camera, by_pixel());
  const auto is_red = [](const RenderPass& pass, int x) {
    const Vec3f color = color_at(pass, x, 32);
    return color.x > color.y;
  };
  EXPECT_TRUE(is_red(z, 24) && is_red(z, 40));  // its mean is nearer
  EXPECT_NE(is_red(pixel, 24), is_red(pixel, 40));
}

// Two balls at about the same distance: a turn makes the depth of the one or of the other smaller.
TEST(PixelOrder, OfARayStaysWhenTheCameraTurns) {
  Gaussians balls(2, host_memory());
  set_gaussian(balls, 0, {-0.5f, 0, 4.0f}, 0.5f, 0.99f, {1, 0, 0});
  set_gaussian(balls, 1, {0.5f, 0, 4.02f}, 0.5f, 0.99f, {0, 1, 0});
  const auto color_of_ray = [&](float angle, const RenderSettings& settings) {
    Camera camera = plain_camera(129, 129);
    camera.cx = camera.cy = 64.5f;
    camera.cam_from_world_rotation = {
        {std::cos(angle), 0, -std::sin(angle)}, {0, 1, 0}, {std::sin(angle), 0, std::cos(angle)}};
    // The pixel that shows the direction (0, 0, 1): its middle is at most half a pixel away.
    const float x = camera.cx - camera.fx * std::tan(angle);
    return color_at(render(balls, camera, settings), int(std::floor(x)), 64);
  };
  const auto is_red = [](const Vec3f& color) { return color.x > color.y; };
  int changes_by_z = 0;
  for (float angle = -0.4f; angle <= 0.4f; angle += 0.05f) {
    EXPECT_EQ(is_red(color_of_ray(angle, by_pixel())), is_red(color_of_ray(0, by_pixel())))
        << angle;
    changes_by_z += is_red(color_of_ray(angle, {})) != is_red(color_of_ray(0, {}));
  }
  EXPECT_GT(changes_by_z, 3);
}

TEST(PixelOrder, IsRefusedThroughLensesAndInSpaceAndTime) {
  const Camera camera = random_camera(40, 30);
  const Gaussians gaussians = random_gaussians(kTypical, 9, camera, 1);
  EXPECT_THROW(render(in_spacetime(gaussians, 1), camera, by_pixel()), UsageError);
  const LensScene& lens = lens_scenes()[0];
  EXPECT_THROW(render(gaussians, with_lens(camera, lens.model, lens.params), by_pixel()),
               UsageError);
}

TEST(PixelOrder, LeavesNothingForTheNextPictureOfAPass) {
  const Camera camera = random_camera(60, 40, 6);
  const Gaussians gaussians = random_gaussians(kTypical, 300, camera, 2);
  RenderPass used;
  const std::unique_ptr<Renderer> renderer = make_scalar_renderer();
  renderer->forward(gaussians.span(), camera, by_pixel(), used);
  renderer->forward(gaussians.span(), camera, {}, used);
  EXPECT_EQ(used.image.download(), render(gaussians, camera, {}).image.download());
}

}  // namespace
}  // namespace gs
