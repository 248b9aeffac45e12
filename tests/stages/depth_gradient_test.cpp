// SPDX-License-Identifier: Apache-2.0
// The gradient of the depth loss through the whole pipeline, in float and by tiles, equals the
// slope of the brute-force depth in double, together with the gradient of a picture.
#include "gs_core/math/loss/depth_loss.h"
#include "gs_render/renderer.h"
#include "gs_render/stages.h"
#include "gs_render/surface_renderer.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/stages/slopes.h"

namespace gs {
namespace {

constexpr float kWeight = 40;  // so that depth and colors have gradients of about one size

/// Gaussians, and a view with a depth map that has holes and a mask.
struct DepthScene {
  Camera camera = slope_camera();
  RenderSettings settings;
  Gaussians gaussians = random_gaussians(kTypical, 9, camera, 21);
  View view;
  std::vector<float> weights = loss_weights(9);  // of the linear loss of colors

  explicit DepthScene(DepthKind kind = DepthKind::inverse) {
    Draws draws(10);
    view.depth = ImageF(kWidth, kHeight, 1);
    view.mask = Image8(kWidth, kHeight, 1);
    view.depth_kind = kind;
    for (std::size_t i = 0; i < kPixels; ++i) {
      view.depth.pixels[i] = draws.chance(0.1f) ? 0 : draws.uniform(1, 6);
      view.mask.pixels[i] = draws.chance(0.2f) ? 0 : std::uint8_t(draws.uniform(1, 255));
    }
  }
};

/// The pipeline's depths, loss and gradients.
struct Pipeline {
  RenderPass pass;
  DepthGradient dL_ddepth;
  Gaussians gradients;
  Buffer<Vec2f> dL_dmean2d;
  double loss = 0;

  explicit Pipeline(const DepthScene& scene) {
    const auto renderer = make_scalar_renderer();
    RenderSettings settings = scene.settings;
    settings.blends_depth = true;
    renderer->forward(scene.gaussians.span(), scene.camera, settings, pass);
    loss = compare_depth(scene.view, kWeight, pass, dL_ddepth);
    const Buffer<float> dL_dimage = uploaded(scene.weights);
    gradients.has_time = scene.gaussians.has_time;
    gradients.resize(scene.gaussians.count());
    dL_dmean2d.resize(scene.gaussians.count());
    renderer->backward(scene.gaussians.span(), scene.camera, settings, pass,
                       {dL_dimage.span(), dL_ddepth.alpha.span(), dL_ddepth.depth.span()},
                       gradients.span(), dL_dmean2d.span());
  }
  double depth_sum(std::size_t i) const { return pass.depth_image[i]; }
  double coverage(std::size_t i) const { return 1 - pass.transmittance[i]; }
};

/// The weights w and targets t of all pixels, which are constants of the gradient.
struct Constants {
  std::vector<double> w = std::vector<double>(kPixels), t = std::vector<double>(kPixels);

  Constants(const DepthScene& scene, const Pipeline& at) {
    const auto value = [&](std::size_t i) { return double(scene.view.depth.pixels[i]); };
    const auto mask = [&](std::size_t i) { return scene.view.mask.pixels[i] / 255.0; };
    DepthTarget target;
    for (int round = 0; round < depth_fit_rounds(scene.view.depth_kind); ++round) {
      DepthSums sums;
      for (std::size_t i = 0; i < kPixels; ++i)
        if (is_known_depth(float(value(i))) && mask(i) > 0)
          add_to(sums,
                 depth_sums_of_pixel(scene.view.depth_kind, value(i), mask(i), at.depth_sum(i),
                                     at.coverage(i), round > 0 ? &target : nullptr));
      target = depth_target(scene.view.depth_kind, sums, double(kWeight));
    }
    EXPECT_GT(target.factor, 0);
    for (std::size_t i = 0; i < kPixels; ++i) {
      if (!is_known_depth(float(value(i))) || !has_depth(at.coverage(i))) continue;
      t[i] = inverse_depth_of(scene.view.depth_kind, target.fit, value(i));
      if (t[i] > 0) w[i] = target.factor * mask(i) * at.coverage(i);
    }
  }
};

/// The picture's loss and that of its depth, in double.
double reference_loss(const std::vector<DoubleGaussian>& gaussians, const DepthScene& scene,
                      const PinholeCamera<double>& camera, const Constants& constants,
                      std::uint64_t& decisions) {
  ReferenceSplats splats = reference_splats<double>(gaussians, camera, scene.settings);
  const ReferencePicture picture = reference_picture(splats, scene.settings, kWidth, kHeight);
  decisions = picture.decisions();
  double loss = linear_loss(scene.weights, picture.planes());
  for (auto& entry : splats.entries) entry.splat.color = {entry.depth, 1, 0};
  RenderSettings of_depth = scene.settings;
  of_depth.background = Vec3f(0);
  const std::vector<double> planes = reference_picture(splats, of_depth, kWidth, kHeight).planes();
  for (std::size_t i = 0; i < kPixels; ++i) {
    if (constants.w[i] == 0) continue;
    const double q = planes[kPixels + i] / planes[i];
    loss += constants.w[i] * std::abs(q - constants.t[i]);
    decisions = decisions * 31 + (q > constants.t[i]);
  }
  return loss;
}

void expect_slopes(const DepthScene& scene, const char* what) {
  SCOPED_TRACE(what);
  const Pipeline pipeline(scene);
  const Constants constants(scene, pipeline);
  const auto camera = camera_as<double>(scene.camera);
  // Floats round at 6e-8, and the terms of a gradient cancel. An edge of a splat, or of |q - t|, is
  // crossed now and then.
  expect_slopes(scene.gaussians, pipeline.gradients, {2e-6, 5e-5, 0.05, false},
                [&](const std::vector<DoubleGaussian>& gaussians, std::uint64_t& decisions) {
                  return reference_loss(gaussians, scene, camera, constants, decisions);
                });
}

TEST(DepthGradient, IsTheSlopeForEachKindOfMap) {
  expect_slopes(DepthScene(DepthKind::metric), "metric");
  expect_slopes(DepthScene(DepthKind::scaled), "scaled");
}

/// A map whose values rise with the depth, or fall, as far as the fit needs it.
DepthScene scene_with_fit(DepthKind kind) {
  DepthScene scene(kind);
  const Pipeline pipeline(scene);
  Draws draws(17);
  for (std::size_t i = 0; i < kPixels; ++i) {
    const double A = pipeline.coverage(i);
    const double depth = A > 0.01 ? pipeline.depth_sum(i) / A : 3;
    float& value = scene.view.depth.pixels[i];
    if (value == 0) continue;
    value = float(kind == DepthKind::inverse ? 10 / depth + 3 : 2 * depth + 1) *
            draws.uniform(0.8f, 1.25f);
  }
  return scene;
}

TEST(DepthGradient, IsTheSlopeForMapsUpToScaleAndShift) {
  expect_slopes(scene_with_fit(DepthKind::relative), "relative");
  expect_slopes(scene_with_fit(DepthKind::inverse), "inverse");
}

TEST(DepthGradient, IsTheSlopeInEveryScene) {
  for (const SceneChange& change : kSceneChanges) {
    DepthScene scene(DepthKind::metric);
    change.apply(scene.camera, scene.settings, scene.gaussians);
    expect_slopes(scene, change.name);
  }
}

TEST(DepthGradient, IsTheSlopeByThePoseOfTheCamera) {
  DepthScene scene(DepthKind::metric);
  const Pipeline pipeline(scene);
  const Constants constants(scene, pipeline);
  const CameraGradient<double> dL =
      camera_gradient(scene.gaussians.span(), scene.camera, scene.settings, pipeline.pass);
  const auto camera = camera_as<double>(scene.camera);
  const RigidFrame<double> frame{camera.cam_from_world_rotation, camera.position()};
  const RigidMotion<double> gradient = moved_vjp(camera, frame, {Vec3d(0.0), Vec3d(0.0)}, dL);
  const std::vector<DoubleGaussian> gaussians = in_double(scene.gaussians);
  double largest = 0, worst = 0;
  for (int k = 0; k < 6; ++k) {
    const auto loss_at = [&](double step, std::uint64_t& decisions) {
      RigidMotion<double> motion{Vec3d(0.0), Vec3d(0.0)};
      (k < 3 ? motion.turn[k] : motion.shift[k - 3]) = step;
      return reference_loss(gaussians, scene, moved(camera, frame, motion), constants, decisions);
    };
    for (double h = 1e-6; h > 1e-9; h /= 4) {
      std::uint64_t above, below;
      const double slope = (loss_at(h, above) - loss_at(-h, below)) / (2 * h);
      if (above != below) continue;
      largest = std::max(largest, std::abs(slope));
      worst = std::max(worst, std::abs(slope - (k < 3 ? gradient.turn[k] : gradient.shift[k - 3])));
      break;
    }
  }
  EXPECT_GT(largest, 0);
  EXPECT_LT(worst / largest, 5e-5);
}

TEST(DepthGradient, LeavesTheColorsAsTheyAre) {
  DepthScene scene;
  RenderPass plain, with_depth;
  for (RenderPass* pass : {&plain, &with_depth}) {
    make_scalar_renderer()->forward(scene.gaussians.span(), scene.camera, scene.settings, *pass);
    scene.settings.blends_depth = true;
  }
  EXPECT_TRUE(same_bits(plain.image, with_depth.image));
  EXPECT_TRUE(same_bits(plain.transmittance, with_depth.transmittance));
  EXPECT_TRUE(same_bits(plain.last_instance, with_depth.last_instance));
  for (std::size_t i = 0; i < plain.splats.size(); ++i)
    EXPECT_TRUE(!plain.tile_counts[i] || plain.splats[i].color == with_depth.splats[i].color);
}

// What training blends and the pictures of depth are one thing.
TEST(DepthGradient, IsOfTheDepthThatIsRendered) {
  const DepthScene scene;
  const Pipeline pipeline(scene);
  const auto renderer = make_scalar_renderer();
  SurfaceRenderer surface(*renderer, scene.gaussians.span(), scene.gaussians, scene.settings);
  const ImageF depth = surface.depth(scene.camera);
  for (std::size_t i = 0; i < kPixels; ++i) {
    const double A = pipeline.coverage(i);
    // 1 - T of a pixel that is hardly covered has few digits.
    EXPECT_NEAR(depth.pixels[i], A >= kMinAlpha ? pipeline.depth_sum(i) / A : 0, 2e-6 / A) << i;
  }
}

TEST(DepthGradient, HasTheSameBitsWithAnyNumberOfThreads) {
  DepthScene scene;
  scene.gaussians = random_gaussians(kTypical, 3000, scene.camera, 5);
  const auto gradients = [&] { return copy_of(Pipeline(scene).gradients); };
  EXPECT_TRUE(same_bits(with_threads(1, gradients), with_threads(7, gradients)));
}

// Statistics of density control see both.
TEST(DepthGradient, IsPartOfTheAbsoluteGradient) {
  DepthScene scene(DepthKind::metric);
  scene.settings.absolute_gradient = true;
  const Pipeline with_depth(scene);
  const ImageF depth = std::exchange(scene.view.depth, ImageF(kWidth, kHeight, 1));
  const Pipeline without(scene);
  EXPECT_EQ(without.loss, 0);
  scene.settings.absolute_gradient = false;
  scene.view.depth = depth;
  const Pipeline with_signs(scene);
  double change = 0;
  for (std::size_t i = 0; i < scene.gaussians.count(); ++i) {
    EXPECT_GE(with_depth.dL_dmean2d[i].x, std::abs(with_signs.dL_dmean2d[i].x) * 0.9999f);
    change += std::abs(with_depth.dL_dmean2d[i].x - without.dL_dmean2d[i].x);
  }
  EXPECT_GT(change, 0);
}

}  // namespace
}  // namespace gs
