// SPDX-License-Identifier: Apache-2.0
// Whole runs on a small scene that the test renders from known Gaussians.
#include "gs_train/loop/trainer.h"

#include <gmock/gmock.h>
#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "gs_core/config/config_words.h"
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/metrics.h"
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/adaptive.h"
#include "tests/support/models.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

class SmallRun : public ::testing::Test {
 protected:
  double psnr_of(const Gaussians& gaussians, const RenderSettings& settings) {
    return evaluate(backend_->renderer(), gaussians.span(), scene_.train_views, settings).psnr;
  }
  /// The Gaussians after a run.
  Gaussians trained(const Config& config) {
    Trainer trainer(scene_, config, *backend_);
    trainer.run();
    return copy_of(trainer.model().gaussians);
  }

  const Scene scene_ = small_scene();
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
};

TEST_F(SmallRun, BringsThePicturesCloseToThePhotos) {
  Trainer trainer(scene_, short_run(), *backend_);
  const double before = psnr_of(trainer.model().gaussians, trainer.settings());
  trainer.run();
  const double after = psnr_of(trainer.model().gaussians, trainer.evaluation_settings());
  EXPECT_GT(after, before + 6) << before << " dB at the start";
  EXPECT_GT(after, 22);
}

TEST_F(SmallRun, GivesTheSameBitsForTheSameSeedAndAnyNumberOfThreads) {
  Config config = short_run();
  config.render.background = Background::random;
  set_thread_count(1);
  const Gaussians one = trained(config);
  set_thread_count(2);
  EXPECT_TRUE(same_bits(trained(config), one));
  set_thread_count(0);
  EXPECT_TRUE(same_bits(trained(config), one));
}

TEST_F(SmallRun, RefusesAModelToStartFromThatItCannotRead) {
  Config config = short_run();
  config.model.start_from = "trained.ply";
  const auto make = [&] { Trainer(scene_, config, *backend_); };
  EXPECT_THAT(make, testing::ThrowsMessage<UsageError>(
                        testing::AllOf(testing::HasSubstr("model.start_from is \"trained.ply\""),
                                       testing::HasSubstr("state_from_model"))));
}

TEST_F(SmallRun, DependsOnTheSeed) {
  Config config = short_run();
  config.train.iterations = 20;
  const Gaussians one = trained(config);
  config.train.seed += 1;
  EXPECT_FALSE(same_bits(trained(config), one));
}

TEST_F(SmallRun, UnderMcmcGrowsToTheCapAndBringsThePicturesCloseToThePhotos) {
  Trainer trainer(scene_, short_mcmc_run(), *backend_);
  trainer.run();
  EXPECT_GT(psnr_of(trainer.model().gaussians, trainer.evaluation_settings()), 22);
  EXPECT_GT(trainer.gaussian_count(), 70u);  // some may be pruned in the end
  EXPECT_LE(trainer.gaussian_count(), 80u);
}

TEST_F(SmallRun, UnderMcmcGivesTheSameBitsForTheSameSeedAndAnyNumberOfThreads) {
  Config config = short_mcmc_run();
  config.train.iterations = 120;
  set_thread_count(1);
  const Gaussians one = trained(config);
  set_thread_count(0);
  EXPECT_TRUE(same_bits(trained(config), one));
  config.train.seed += 1;
  EXPECT_FALSE(same_bits(trained(config), one));
}

TEST_F(SmallRun, WithAbsoluteGradientsGrowsMoreAtTheSameThreshold) {
  Config config = short_run();
  config.density.from_step = config.density.every = 50;
  const Gaussians plain = trained(config);
  config.density.strategy = "absgs";
  EXPECT_GT(trained(config).count(), plain.count());
}

TEST_F(SmallRun, FindsOutHowManyGaussiansThereIsMemoryFor) {
  Config config = short_run();
  config.train.iterations = 10;
  config.density.max_gaussians = kAutoCount;
  Trainer trainer(scene_, config, *backend_);
  EXPECT_GT(trainer.config().density.max_gaussians, 100);
}

/// Records what it sees, and asks for the end after one step.
class Watcher : public Observer {
 public:
  explicit Watcher(int stop_after = 0) : stop_after_(stop_after) {}
  void after_step(int step, Trainer& trainer) override {
    steps.push_back(step);
    EXPECT_TRUE(std::isfinite(trainer.loss()));
    if (step == stop_after_) trainer.stop();
  }
  void after_run(Trainer&) override { ++runs; }

  std::vector<int> steps;
  int runs = 0;

 private:
  int stop_after_;
};

TEST_F(SmallRun, ShowsEveryStepAndTheEndToItsObservers) {
  Config config = short_run();
  config.train.iterations = 12;
  Watcher watcher;
  Trainer trainer(scene_, config, *backend_);
  trainer.add_observer(watcher);
  trainer.run();
  EXPECT_EQ(watcher.steps, (std::vector<int>{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}));
  EXPECT_EQ(watcher.runs, 1);
  EXPECT_FALSE(trainer.stopped_early());
}

TEST_F(SmallRun, EndsWithTheStepAfterStopAndAsIfThatWereTheLast) {
  Watcher watcher(5);
  Trainer stopped(scene_, short_run(), *backend_);
  stopped.add_observer(watcher);
  stopped.run();
  EXPECT_TRUE(stopped.stopped_early());
  EXPECT_EQ(watcher.steps.back(), 6);
  EXPECT_EQ(watcher.runs, 1);
  TrainingModel finished = model_of(stopped.model().gaussians);
  EXPECT_EQ(backend_->rows().prune(finished, kMinAlpha), 0u);
  backend_->rows().sort_by_morton(finished);
  EXPECT_TRUE(same_bits(finished.gaussians, stopped.model().gaussians));
}

TEST_F(SmallRun, TrainsUnderEverySettingOfTheRenderer) {
  for (const Background background : {Background::white, Background::random})
    for (const bool antialias : {false, true}) {
      Config config = short_run();
      config.train.iterations = 60;
      config.render.background = background;
      config.render.antialias = antialias;
      config.render.blend_rule = antialias ? BlendRule::classic : BlendRule::faster_gs;
      config.render.truncation = antialias ? Truncation::sigma3 : Truncation::alpha;
      const Gaussians gaussians = trained(config);
      for (const float value : numbers_of(gaussians.mean)) EXPECT_TRUE(std::isfinite(value));
    }
}

/// The scene with a disc as mask in each photo; where the mask is black, `garbage` is xor'ed into
/// the photo.
Scene masked_scene(const Scene& scene, std::uint8_t garbage) {
  Scene masked;
  masked.points = scene.points;
  masked.extent = scene.extent;
  for (View view : scene.train_views) {
    view.mask = Image8(view.photo.width, view.photo.height, 1);
    for (int y = 0; y < view.photo.height; ++y)
      for (int x = 0; x < view.photo.width; ++x) {
        const bool is_inside = (x - 24) * (x - 24) + (y - 18) * (y - 18) < 14 * 14;
        view.mask.at(x, y, 0) = is_inside ? 255 : 0;
        for (int c = 0; c < 3 && !is_inside; ++c) view.photo.at(x, y, c) ^= garbage;
      }
    masked.train_views.push_back(std::move(view));
  }
  return masked;
}

TEST_F(SmallRun, DoesNotSeeWhatMasksIgnore) {
  const Scene clean = masked_scene(scene_, 0), dirty = masked_scene(scene_, 0xb7);
  ASSERT_NE(clean.train_views[0].photo.pixels, dirty.train_views[0].photo.pixels);
  Trainer on_clean(clean, short_run(), *backend_);
  on_clean.run();
  const Gaussians of_clean = copy_of(on_clean.model().gaussians);
  Trainer on_dirty(dirty, short_run(), *backend_);
  on_dirty.run();
  EXPECT_TRUE(same_bits(copy_of(on_dirty.model().gaussians), of_clean));
  EXPECT_FALSE(same_bits(trained(short_run()), of_clean));  // masks do matter
  const Evaluation evaluation = evaluate(backend_->renderer(), on_dirty.model().gaussians.span(),
                                         dirty.train_views, on_dirty.evaluation_settings());
  EXPECT_GT(evaluation.psnr, 22);  // measured on trained pixels
}

/// The Gaussians of the scene without background: color, and alpha as mask.
Scene cut_out_scene(const Scene& scene, Renderer& renderer, const GaussiansSpan& truth) {
  Scene cut_out;
  cut_out.points = scene.points;
  cut_out.extent = scene.extent;
  RenderPass pass;
  for (View view : scene.train_views) {
    renderer.forward(truth, view.camera, {}, pass);
    view.mask = Image8(view.photo.width, view.photo.height, 1);
    for (std::size_t i = 0; i < pass.pixel_count(); ++i) {
      const float cover = 1 - pass.transmittance[i];
      view.mask.pixels[i] = std::uint8_t(std::lround(255 * cover));
      for (int c = 0; c < 3; ++c) {
        const float color = cover > 0 ? pass.image[c * pass.pixel_count() + i] / cover : 0.5f;
        view.photo.pixels[3 * i + c] = std::uint8_t(std::lround(255 * std::min(color, 1.0f)));
      }
    }
    view.over_background = true;
    cut_out.train_views.push_back(std::move(view));
  }
  return cut_out;
}

// On a single background, Gaussians of its color could replace it.
TEST_F(SmallRun, OnRandomBackgroundsLearnsWhatAlphaCovers) {
  Config config = short_run();
  config.render.background = Background::random;
  const Scene cut_out = cut_out_scene(scene_, backend_->renderer(), small_truth().span());
  Trainer trainer(cut_out, config, *backend_);
  trainer.run();
  for (const Vec3f& background : {Vec3f(0.0f), Vec3f(1.0f), Vec3f(0, 1, 0)}) {
    RenderSettings settings = trainer.evaluation_settings();
    settings.background = background;
    EXPECT_GT(evaluate(backend_->renderer(), trainer.model().gaussians.span(), cut_out.train_views,
                       settings)
                  .psnr,
              22);
  }
}

TEST_F(SmallRun, EndsWithoutFaintGaussians) {
  for (const float logit : trained(short_run()).logit_opacity)
    EXPECT_GE(sigmoid(logit), 1.0f / 255);
}

TEST_F(SmallRun, KeepsShDegreesThatWereNotReachedAtZero) {
  Config config = short_run();
  config.model.sh_degree = 0;
  const Gaussians gaussians = trained(config);
  for (std::size_t i = 0; i < gaussians.count(); ++i)
    EXPECT_TRUE(row_is(gaussians.sh_rest, i, 0.0f));
}

TEST(Trainer, ALossThatTheBackendLacksIsRefusedWhenARunIsMade) {
  const auto backend = make_scalar_backend();
  Config config = adaptive_config();
  config.loss.kind = "l2";
  try {
    const Trainer trainer(small_scene(), config, *backend);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_NE(std::string(error.what()).find("no loss.kind l2 on cpu; it is one of l1_ssim"),
              std::string::npos)
        << error.what();
  }
}

TEST(Losses, TheSettingTakesEveryLossOfTheTableAndNoOther) {
  const std::vector<std::string> losses = make_scalar_backend()->features().losses;
  for (const std::string& name : losses) {
    Config config = adaptive_config();
    config.loss.kind = name;
    validate(config);
    make_scalar_backend()->use({name});
  }
  EXPECT_EQ(fmt::format("{}", fmt::join(losses, ", ")), kLossWords);
}

TEST(Trainer, WithoutViewsSaysSo) {
  Scene scene = small_scene();
  scene.train_views.clear();
  const auto backend = make_scalar_backend();
  EXPECT_THROW(Trainer(scene, {}, *backend), Error);
}

}  // namespace
}  // namespace gs
