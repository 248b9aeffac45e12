// SPDX-License-Identifier: Apache-2.0
// Runs with depth maps: the step, the schedule, resuming, ranks, and what they gain with few
// photos.
#include "gs_core/math/loss/depth_loss.h"
#include "gs_eval/depth_error.h"
#include "gs_render/surface_renderer.h"
#include "gs_train/reduced_view.h"
#include "tests/support/corner_scene.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

/// The depth of the Gaussians that the photos show, where they cover at least half of a pixel.
ImageF true_depth(const Gaussians& truth, const Camera& camera) {
  const auto renderer = make_scalar_renderer();
  RenderPass pass;
  renderer->forward(truth.span(), camera, {}, pass);
  SurfaceRenderer surface(*renderer, truth.span(), truth, {});
  ImageF depth = surface.depth(camera);
  for (std::size_t i = 0; i < depth.pixels.size(); ++i)
    if (pass.transmittance[i] > 0.5f) depth.pixels[i] = 0;
  return depth;
}

/// Turns exact depth into a map of the kind, with a scale and a shift of its own.
void disturb_map(View& view, DepthKind kind, float scale, float shift) {
  view.depth_kind = kind;
  view.has_depth_map = true;
  for (float& value : view.depth.pixels) {
    if (value == 0 || kind == DepthKind::metric) continue;
    value = kind == DepthKind::inverse ? scale / value + shift : scale * value;
    if (kind == DepthKind::relative) value += shift;
  }
}

Scene scene_with_maps(DepthKind kind) {
  Scene scene = small_scene();
  const Gaussians truth = small_truth();
  for (std::size_t k = 0; k < scene.train_views.size(); ++k) {
    View& view = scene.train_views[k];
    view.depth = true_depth(truth, view.camera);
    disturb_map(view, kind, 1 + 0.3f * float(k % 4), 0.2f * float(k % 3));
  }
  return scene;
}

class DepthRun : public SceneRun {
 protected:
  DepthRun() : SceneRun(scene_with_maps(DepthKind::inverse)) {}
  static Config depth_run(int steps = 120) {
    Config config = growing_run(steps);
    config.loss.depth_weight = 1;
    return config;
  }
};

TEST_F(DepthRun, IsAnyOtherRunWithoutMaps) {
  const Scene plain = small_scene();
  Config without = depth_run();
  without.loss.depth_weight = 0;
  EXPECT_TRUE(same_bits(model_of_run(plain, depth_run(), *backend_), trained(without)));
}

TEST_F(DepthRun, IsAnyOtherRunWithMapsThatKnowNothing) {
  Scene blank = small_scene();
  for (View& view : blank.train_views) {
    view.depth = ImageF(view.camera.width, view.camera.height, 1);
    view.has_depth_map = true;
  }
  const TrainingModel unknown = model_of_run(blank, depth_run(), *backend_),
                      without = model_of_run(small_scene(), depth_run(), *backend_);
  // Zeros are added, which may turn -0 into 0.
  for (std::size_t i = 0; i < unknown.count(); ++i)
    EXPECT_EQ(unknown.gaussians.mean[i], without.gaussians.mean[i]);
}

TEST_F(DepthRun, GoesOnWhereItWasStopped) {
  expect_goes_on_after({7, 60}, depth_run());
  Config batches = depth_run();
  batches.train.batch = 3;
  batches.train.resolution_ramp = {2};
  batches.train.resolution_every = 8000;  // 32 steps
  batches.train.resolution_least = 1;
  expect_goes_on_after({8, 31, 90}, batches);
}

TEST_F(DepthRun, HasTheSameBitsWithAnyNumberOfThreads) {
  expect_same_bits_on_any_threads(depth_run(50));
}

// The weight of the loss falls from the first to the last step.
TEST_F(DepthRun, WeightDecaysExponentially) {
  const Schedule schedule(depth_run(1000), 1);
  EXPECT_NEAR(schedule.depth_weight(1), 1, 6e-3);
  EXPECT_NEAR(schedule.depth_weight(500), 0.1, 1e-6);
  EXPECT_NEAR(schedule.depth_weight(1000), 0.01, 1e-8);
  Config extended = depth_run(1000);
  extended.train.extra_steps = 50;
  EXPECT_NEAR(Schedule(extended, 1).depth_weight(1040), 0.01, 1e-8);
  Config off = depth_run();
  off.loss.depth_weight = 0;
  EXPECT_EQ(Schedule(off, 1).depth_weight(10), 0);
}

TEST(DepthLossOfAView, IsZeroUnderAMask) {
  View view = scene_with_maps(DepthKind::metric).train_views[0];
  const std::size_t pixels = view.depth.pixels.size();
  RenderPass pass;
  pass.depth_image.upload(std::vector<float>(pixels, 4.0f));  // a depth of 5
  pass.transmittance.upload(std::vector<float>(pixels, 0.2f));
  DepthGradient dL;
  const auto count_taught = [&] {
    std::size_t taught = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      EXPECT_EQ(dL.depth[i] != 0, dL.alpha[i] != 0);
      taught += dL.depth[i] != 0;
    }
    return taught;
  };
  make_scalar_backend();
  EXPECT_GT(compare_depth(view, 1, pass, dL), 0);
  std::size_t known = 0;
  for (const float value : view.depth.pixels) known += is_known_depth(value);
  EXPECT_EQ(count_taught(), known);
  view.mask = Image8(view.camera.width, view.camera.height, 1);
  for (std::size_t i = 0; i < pixels / 2; ++i) view.mask.pixels[i] = 255;
  compare_depth(view, 1, pass, dL);
  for (std::size_t i = pixels / 2; i < pixels; ++i) EXPECT_EQ(dL.depth[i], 0);
  EXPECT_GT(count_taught(), 0u);
  std::fill(view.mask.pixels.begin(), view.mask.pixels.end(), std::uint8_t(0));
  EXPECT_EQ(compare_depth(view, 1, pass, dL), 0);
  EXPECT_EQ(count_taught(), 0u);
}

TEST(DepthLossOfAView, IsThatOfTheReducedMapWhereThePhotoIsReduced) {
  const View view = scene_with_maps(DepthKind::metric).train_views[0];
  const View reduced = reduced_view(view, 3);
  ASSERT_EQ(reduced.depth.width, view.camera.width / 3);
  EXPECT_EQ(reduced.depth.at(2, 4, 0), view.depth.at(7, 13, 0));
  EXPECT_EQ(reduced.depth_kind, DepthKind::metric);
}

// ---- what it measures, and what it gains -------------------------------------------------------

TEST(DepthError, IsThatOfTheDepth) {
  View view;
  view.depth = ImageF(2, 2, 1);
  view.depth.pixels = {2, 4, 0, 5};
  view.depth_kind = DepthKind::metric;
  ImageF rendered(2, 2, 1);
  rendered.pixels = {2.2f, 3, 9, 5};  // off by 10 %, 25 %, not known, right
  EXPECT_NEAR(*depth_error(rendered, view), 0.35 / 3, 1e-6);
  rendered.pixels[3] = 0;  // nothing is drawn
  EXPECT_NEAR(*depth_error(rendered, view), 1.35 / 3, 1e-6);
  view.mask = Image8(2, 2, 1);
  view.mask.pixels = {255, 255, 255, 0};
  EXPECT_NEAR(*depth_error(rendered, view), 0.35 / 2, 1e-6);
  view.depth_kind = DepthKind::scaled;
  view.mask = {};
  rendered.pixels = {6, 12, 1, 15};
  EXPECT_NEAR(*depth_error(rendered, view), 0, 1e-6);
  view.depth = {};
  EXPECT_EQ(depth_error(rendered, view), std::nullopt);
}

void disturb_map(View& view, DepthKind kind, Draws& draws) {
  const float scale = draws.uniform(0.5f, 2), shift = draws.uniform(0.1f, 0.5f);
  disturb_map(view, kind, scale, shift);
}

/// The corner, with maps of the kind.
Scene corner_with_maps(DepthKind kind, std::uint64_t seed) {
  return corner_scene(seed, [&](View& view, Draws& draws) { disturb_map(view, kind, draws); });
}

struct Measured {
  double psnr = 0, depth = 0;
};

Measured trained_on_corner(DepthKind kind, float weight, std::uint64_t seed) {
  const Scene scene = corner_with_maps(kind, seed);
  Config config = corner_run(seed);
  config.loss.depth_weight = weight;
  const auto backend = make_scalar_backend();
  Trainer trainer(scene, config, *backend);
  trainer.run();
  const RenderSettings settings = trainer.evaluation_settings();
  const Gaussians& gaussians = trainer.model().gaussians;
  Evaluation evaluation =
      evaluate(backend->renderer(), gaussians.span(), scene.test_views, settings);
  measure_depth(backend->renderer(), gaussians, scene.test_views, settings, evaluation);
  return {evaluation.psnr, evaluation.depth_error.value_or(1)};
}

// Of photos that are held out, and up to what the kind of map leaves open: without sparse points
// that anchor them, maps of scale and shift teach shapes and no distances.
TEST(DepthTeacher, BringsDepthNearerToTheTruthWithFewPhotos) {
  for (const DepthKind kind :
       {DepthKind::metric, DepthKind::scaled, DepthKind::relative, DepthKind::inverse}) {
    const Measured alone = trained_on_corner(kind, 0, 1);
    const Measured taught = trained_on_corner(kind, LossConfig{}.depth_weight, 1);
    EXPECT_LT(taught.depth, 0.6 * alone.depth) << word_of(kind);
    EXPECT_GT(taught.psnr, 45) << word_of(kind);
  }
}

}  // namespace
}  // namespace gs
