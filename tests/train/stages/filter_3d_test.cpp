// SPDX-License-Identifier: Apache-2.0
// The 3D filter in training: how it is measured, what row operations do with it, whole runs, and
// what a camera sees that comes closer than those of the photos.
#include "gs_core/math/render/filter_3d.h"

#include "gs_core/bake_filter.h"
#include "gs_train/row_rules.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

constexpr float kNear = 0.2f;
const float kUnit = std::sqrt(kFilter3dVariance);  // the filter at a sampling rate of 1

/// A camera at the origin that looks along z, of 100 x 100 pixels.
Camera camera_of(float focal) {
  return {.width = 100, .height = 100, .fx = focal, .fy = focal, .cx = 50, .cy = 50};
}

/// Rows at these depths on the axis of such cameras.
TrainingModel rows_at(const std::vector<float>& depths) {
  Gaussians gaussians(depths.size(), host_memory());
  for (std::size_t i = 0; i < depths.size(); ++i)
    set_gaussian(gaussians, i, {0, 0, depths[i]}, 0.1f, 0.5f);
  return model_of(gaussians);
}

TEST(MeasureFilter, IsThatOfTheCameraThatSamplesARowMostDensely) {
  TrainingModel model = rows_at({1, 4});
  const auto rows = make_scalar_row_ops();
  rows->measure_filter(model, {camera_of(20), camera_of(80), camera_of(40)}, kNear);
  ASSERT_TRUE(model.gaussians.has_filter);
  EXPECT_FLOAT_EQ(model.gaussians.filter_scale[0], kUnit / 80);
  EXPECT_FLOAT_EQ(model.gaussians.filter_scale[1], kUnit * 4 / 80);
}

TEST(MeasureFilter, IsTheLargestWhereNoCameraSeesARow) {
  TrainingModel model = rows_at({1, -3, 5, 0.1f, 2});
  make_scalar_row_ops()->measure_filter(model, {camera_of(50)}, kNear);
  const float largest = kUnit * 5 / 50;
  EXPECT_FLOAT_EQ(model.gaussians.filter_scale[1], largest);
  EXPECT_FLOAT_EQ(model.gaussians.filter_scale[3], largest);
  EXPECT_LT(model.gaussians.filter_scale[4], largest);

  TrainingModel unseen = rows_at({-1, -2});
  make_scalar_row_ops()->measure_filter(unseen, {camera_of(50)}, kNear);
  EXPECT_EQ(unseen.gaussians.filter_scale[0], 0);
}

// ---- row operations

/// Rows that all grow; of the even ones a filter leaves almost nothing.
TrainingModel half_faded() {
  TrainingModel model = rows_at({1, 2, 3, 4});
  model.gaussians.has_filter = true;
  model.gaussians.filter_scale.upload({10, 0.001f, 11, 0.002f});
  for (float& visits : model.statistics.visits) visits = 1;
  for (float& norm : model.statistics.gradient_norm) norm = 1;
  return model;
}

constexpr AdaptiveRules kRules{.gradient_threshold = 0.5f,
                               .small_scale = 1,
                               .prune_opacity = 0.005f,
                               .prune_scale = 1e30f,
                               .max_gaussians = 0};

TEST(FilteredRows, CopiesHaveTheFilterOfTheirParentAndFadedRowsGo) {
  TrainingModel model = half_faded();
  const RefineReport report = make_scalar_row_ops()->grow(model, GrowthRules{kRules}, 1, 600);
  EXPECT_EQ(report.pruned, 2u);
  EXPECT_EQ(report.cloned, 2u);
  EXPECT_EQ(model.gaussians.filter_scale.download(),
            (std::vector<float>{0.001f, 0.002f, 0.001f, 0.002f}));
}

TEST(FilteredRows, SplitHalvesHaveTheFilterOfTheirParent) {
  TrainingModel model = half_faded();
  AdaptiveRules rules = kRules;
  rules.small_scale = 0.01f;
  rules.prune_opacity = 0;
  make_scalar_row_ops()->grow(model, GrowthRules{rules}, 1, 600);
  EXPECT_EQ(model.gaussians.filter_scale.download(),
            (std::vector<float>{10, 10, 0.001f, 0.001f, 11, 11, 0.002f, 0.002f}));
}

TEST(FilteredRows, ThePruneLooksAtTheOpacityAfterTheFilter) {
  TrainingModel model = half_faded();
  EXPECT_EQ(make_scalar_row_ops()->prune(model, kMinAlpha), 2u);
  EXPECT_EQ(model.gaussians.filter_scale.download(), (std::vector<float>{0.001f, 0.002f}));
}

TEST(FilteredRows, MoveWithTheirFilterAlongTheMortonCurve) {
  TrainingModel model = rows_at({4, 1, 3, 2});
  model.gaussians.has_filter = true;
  model.gaussians.filter_scale.upload({4, 1, 3, 2});
  make_scalar_row_ops()->sort_by_morton(model);
  for (std::size_t i = 0; i < 4; ++i)
    EXPECT_EQ(model.gaussians.filter_scale[i], model.gaussians.mean[i].z);
}

TEST(FilteredRows, RelocatedCopiesHaveTheFilterOfTheirSource) {
  TrainingModel model = rows_at({1, 2});
  model.gaussians.logit_opacity[0] = -20;  // dead
  model.gaussians.has_filter = true;
  model.gaussians.filter_scale.upload({0.5f, 0.25f});
  make_scalar_row_ops()->relocate(model, {0.005f, 4}, 1, 600);
  EXPECT_EQ(model.gaussians.filter_scale.download(), std::vector<float>(4, 0.25f));
}

TEST(FilteredRows, AResetCapsTheOpacityAfterTheFilter) {
  for (const bool by_rule : {false, true}) {
    TrainingModel model = rows_at({1, 2, 3});
    model.gaussians.has_filter = true;
    model.gaussians.filter_scale.upload({1e-6f, 0.1f, 10});
    const auto rows = make_scalar_row_ops();
    if (by_rule)
      rows->lower_opacity(model, {OpacityPolicy::reset, 0.01f, MomentClearing::opacity});
    else
      rows->reset_opacity(model, 0.01f);
    const GaussiansSpan span = model.gaussians.span();
    const auto drawn = [&](std::size_t i) {
      return sigmoid(span.logit_opacity[i]) * filter_share(span, i, span.log_scale[i]);
    };
    EXPECT_NEAR(drawn(0), 0.01f, 1e-6f);
    EXPECT_NEAR(drawn(1), 0.01f, 1e-6f);
    EXPECT_LT(drawn(2), 0.01f);                                // it was fainter already,
    EXPECT_NEAR(sigmoid(span.logit_opacity[2]), 0.5f, 1e-6f);  // and stays as it is
  }
}

// ---- whole runs

class FilteredRun : public SceneRun {
 protected:
  FilteredRun() : SceneRun(small_scene()) {}
  static Config config(bool has_filter = true) {
    Config config = short_run();
    config.model.filter_3d = has_filter;
    config.density.from_step = config.density.every = 50;
    config.density.gradient_threshold = 5e-5f;
    return config;
  }
  /// Rows whose thinnest axis is thinner than the training photos can show of them.
  std::size_t too_thin(GaussianModel model) {
    TrainingModel rows;
    rows.gaussians = std::move(model.gaussians);
    std::vector<Camera> cameras;
    for (const View& view : scene_.train_views) cameras.push_back(view.camera);
    make_scalar_row_ops()->measure_filter(rows, cameras, kNear);
    std::size_t count = 0;
    for (std::size_t i = 0; i < rows.count(); ++i) {
      const Vec3f& s = rows.gaussians.log_scale[i];
      count += std::exp(std::min({s.x, s.y, s.z})) < 0.999f * rows.gaussians.filter_scale[i];
    }
    return count;
  }
};

// The photos are as sharp as their pixels: without a filter many Gaussians become thinner.
TEST_F(FilteredRun, EndsWithoutGaussiansThinnerThanThePhotosCanShow) {
  for (const bool has_filter : {false, true}) {
    Config sharp = config(has_filter);
    sharp.optimizer.log_scale_lr = 0.05f;
    Trainer trainer(scene_, sharp, *backend_);
    trainer.run();
    const GaussianModel model = trained_model(trainer);
    EXPECT_FALSE(model.gaussians.has_filter);
    const std::size_t thin = too_thin(trained_model(trainer));
    if (has_filter)
      EXPECT_EQ(thin, 0u);
    else
      EXPECT_GT(thin, model.gaussians.count() / 20);
  }
}

TEST_F(FilteredRun, BringsThePicturesAsCloseToThePhotos) { EXPECT_GT(psnr_after(config()), 22); }

TEST_F(FilteredRun, TheModelLooksTheSameWithItsFilterBakedIn) {
  Trainer trainer(scene_, config(), *backend_);
  trainer.run();
  const GaussianModel raw = raw_model(trainer), baked = trained_model(trainer);
  ASSERT_TRUE(raw.gaussians.has_filter);
  ASSERT_EQ(raw.gaussians.count(), baked.gaussians.count());
  RenderPass one, other;
  const Camera& camera = scene_.train_views[0].camera;
  backend_->renderer().forward(raw.gaussians.span(), camera, trainer.evaluation_settings(), one);
  backend_->renderer().forward(baked.gaussians.span(), camera, trainer.evaluation_settings(),
                               other);
  for (std::size_t i = 0; i < one.image.size(); ++i)
    ASSERT_NEAR(one.image[i], other.image[i], 5e-3f) << i;  // a fragment at 1/255 may be on one
}

TEST_F(FilteredRun, GoesOnFromACheckpointToTheSameBits) {
  expect_goes_on_after({30, 120, 200}, config());
  Config mcmc = config();
  mcmc.density.strategy = "mcmc";
  mcmc.density.max_gaussians = 80;
  mcmc.density.until_step = 24900;
  expect_goes_on_after({120}, mcmc);
}

TEST_F(FilteredRun, HasNoFilterWhereItIsNotAskedFor) {
  const TrainingModel model = trained(config(false));
  EXPECT_FALSE(model.gaussians.has_filter);
  EXPECT_TRUE(model.gaussians.filter_scale.empty());
}

TEST_F(FilteredRun, IsRefusedForScenesThatMove) {
  Config moving = config();
  moving.model.dynamic = true;
  EXPECT_THAT(
      [&] { Trainer(scene_, moving, *backend_); },
      ThrowsMessage<UsageError>(AllOf(HasSubstr("model.filter_3d"), HasSubstr("model.dynamic"))));
}

// ---- closer than the photos, and farther away

/// (3, H, W) of a view at `zoom` times its size.
std::vector<float> planes_of(Renderer& renderer, const Gaussians& gaussians, const Camera& camera,
                             float zoom, bool antialias) {
  RenderSettings settings;
  settings.antialias = antialias;
  const auto side = [zoom](int pixels) { return int(zoom * float(pixels)); };
  RenderPass pass;
  renderer.forward(gaussians.span(), resized(camera, side(camera.width), side(camera.height)),
                   settings, pass);
  return pass.image.download();
}

/// Means over blocks of n x n pixels of planes (3, height, width).
std::vector<float> block_means(const std::vector<float>& planes, int width, int height, int n) {
  const int w = width / n, h = height / n;
  std::vector<float> means(std::size_t(3 * w * h));
  for (int c = 0; c < 3; ++c)
    for (int y = 0; y < h * n; ++y)
      for (int x = 0; x < w * n; ++x)
        means[(c * h + y / n) * w + x / n] += planes[(c * height + y) * width + x] / float(n * n);
  return means;
}

double psnr_between(const std::vector<float>& a, const std::vector<float>& b) {
  double error = 0;
  for (std::size_t i = 0; i < a.size(); ++i) error += std::pow(double(a[i]) - b[i], 2);
  return -10 * std::log10(error / double(a.size()));
}

/// A scene with detail finer than a pixel. Its photos are means over their pixels.
Scene fine_scene() {
  constexpr int kSamples = 8;  // along a pixel's side
  Scene scene = small_scene();
  Draws draws(5);
  Gaussians truth(600, host_memory());
  scene.points.clear();
  for (std::size_t i = 0; i < truth.count(); ++i) {
    const Vec3f place = draws.uniform3(-0.8f, 0.8f);
    const Vec3f color = draws.uniform3(0, 1);
    const float size = draws.uniform(0.01f, 0.04f);
    set_gaussian(truth, i, place, size, 0.9f, color);
    if (i % 2) scene.points.push_back({place, {128, 128, 128}});
  }
  const auto renderer = make_scalar_renderer();
  for (View& view : scene.train_views) {
    const Camera& camera = view.camera;
    const std::vector<float> photo =
        block_means(planes_of(*renderer, truth, camera, kSamples, true), kSamples * camera.width,
                    kSamples * camera.height, kSamples);
    const std::size_t pixels = photo.size() / 3;
    for (std::size_t i = 0; i < 3 * pixels; ++i)
      view.photo.pixels[3 * (i % pixels) + i / pixels] =
          std::uint8_t(std::lround(255 * std::min(photo[i], 1.0f)));
  }
  return scene;
}

/// How well pictures of one model at several resolutions agree: PSNR of the finer one, averaged
/// over the pixels of the coarser one, in the mean of all views.
struct Agreement {
  double at_4x, at_quarter;
};

class FineRun : public SceneRun {
 protected:
  FineRun() : SceneRun(fine_scene()) {}
  Agreement agreement_after(bool has_filter, bool antialias) {
    Config config = short_run();
    config.train.iterations = 400;
    config.optimizer.log_scale_lr = 0.05f;
    config.model.filter_3d = has_filter;
    config.render.antialias = antialias;
    Trainer trainer(scene_, config, *backend_);
    trainer.run();
    const GaussianModel model = trained_model(trainer);
    Agreement mean{0, 0};
    const double views = double(scene_.train_views.size());
    for (const View& view : scene_.train_views) {
      const int w = view.camera.width, h = view.camera.height;
      const auto at = [&](float zoom) {
        return planes_of(backend_->renderer(), model.gaussians, view.camera, zoom, antialias);
      };
      mean.at_4x += psnr_between(block_means(at(4), 4 * w, 4 * h, 4), at(1)) / views;
      mean.at_quarter += psnr_between(block_means(at(1), w, h, 4), at(0.25f)) / views;
    }
    return mean;
  }
};

// Without filters Gaussians become thinner than a pixel, because splats are widened by a fixed
// number of pixels: four times closer they are threads with gaps, and from afar a bright mass.
TEST_F(FineRun, PicturesFromAQuarterToFourTimesTheResolutionAgreeWithBothFilters) {
  const Agreement neither = agreement_after(false, false), filter = agreement_after(true, false),
                  antialiased = agreement_after(false, true), both = agreement_after(true, true);
  EXPECT_LT(neither.at_4x, 20);
  EXPECT_GT(filter.at_4x, neither.at_4x + 4);
  EXPECT_GT(both.at_4x, antialiased.at_4x + 4);
  EXPECT_GT(both.at_4x, 45);
  EXPECT_LT(neither.at_quarter, 15);
  EXPECT_GT(both.at_quarter, 30);
}

}  // namespace
}  // namespace gs
