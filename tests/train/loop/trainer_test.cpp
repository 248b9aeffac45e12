// SPDX-License-Identifier: Apache-2.0
// Whole runs on a small scene that the test renders from known Gaussians.
#include "gs_train/loop/trainer.h"

#include <spdlog/fmt/fmt.h>

#include "gs_core/config/config_words.h"
#include "tests/support/own_loss.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

class SmallRun : public SceneRun {
 protected:
  SmallRun() : SceneRun(small_scene()) {}
  double psnr_of(const Gaussians& gaussians, const RenderSettings& settings) {
    return evaluate(backend_->renderer(), gaussians.span(), scene_.train_views, settings).psnr;
  }
  Gaussians gaussians_after(const Config& config) { return copy_of(trained(config).gaussians); }
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
  expect_same_bits_on_any_threads(config);
  config = short_mcmc_run();
  config.train.iterations = 120;
  expect_same_bits_on_any_threads(config);
}

TEST_F(SmallRun, RefusesAModelToStartFromThatItCannotRead) {
  Config config = short_run();
  config.model.start_from = "trained.ply";
  const auto make = [&] { Trainer(scene_, config, *backend_); };
  EXPECT_THAT(make,
              ThrowsMessage<UsageError>(AllOf(HasSubstr("model.start_from is \"trained.ply\""),
                                              HasSubstr("state_from_model"))));
}

TEST_F(SmallRun, DependsOnTheSeed) {
  for (Config config : {short_run(), short_mcmc_run()}) {
    config.train.iterations = 40;
    const TrainingModel one = trained(config);
    config.train.seed += 1;
    EXPECT_FALSE(same_bits(trained(config), one));
  }
}

TEST_F(SmallRun, UnderMcmcGrowsToTheCapAndBringsThePicturesCloseToThePhotos) {
  Trainer trainer(scene_, short_mcmc_run(), *backend_);
  trainer.run();
  EXPECT_GT(psnr_of(trainer.model().gaussians, trainer.evaluation_settings()), 22);
  EXPECT_GT(trainer.gaussian_count(), 70u);  // some may be pruned in the end
  EXPECT_LE(trainer.gaussian_count(), 80u);
}

TEST_F(SmallRun, WithAbsoluteGradientsGrowsMoreAtTheSameThreshold) {
  Config config = short_run();
  config.density.from_step = config.density.every = 50;
  const std::size_t plain = trained(config).count();
  config.density.strategy = "absgs";
  EXPECT_GT(trained(config).count(), plain);
}

TEST_F(SmallRun, FindsOutHowManyGaussiansThereIsMemoryFor) {
  Config config = short_run();
  config.train.iterations = 10;
  config.density.max_gaussians = kAutoCount;
  Trainer trainer(scene_, config, *backend_);
  EXPECT_GT(trainer.config().density.max_gaussians, 100);
}

/// Counts the ends of runs, besides.
class Watcher final : public After {
 public:
  using After::After;
  void after_run(Trainer&) override { ++runs; }
  int runs = 0;
};

TEST_F(SmallRun, ShowsEveryStepAndTheEndToItsObservers) {
  Config config = short_run();
  config.train.iterations = 12;
  std::vector<int> steps;
  Watcher watcher([&](int step, Trainer& trainer) {
    steps.push_back(step);
    EXPECT_TRUE(std::isfinite(trainer.loss()));
  });
  Trainer trainer(scene_, config, *backend_);
  trainer.add_observer(watcher);
  trainer.run();
  EXPECT_THAT(steps, ElementsAre(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12));
  EXPECT_EQ(watcher.runs, 1);
  EXPECT_FALSE(trainer.stopped_early());
}

TEST_F(SmallRun, EndsWithTheStepAfterStopAndAsIfThatWereTheLast) {
  Watcher watcher([](int step, Trainer& trainer) {
    if (step == 5) trainer.stop();
  });
  Trainer stopped(scene_, short_run(), *backend_);
  stopped.add_observer(watcher);
  stopped.run();
  EXPECT_TRUE(stopped.stopped_early());
  EXPECT_EQ(stopped.step(), 6);
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
      psnr_after(config);  // all its numbers are finite
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
  const TrainingModel of_clean = model_of_run(clean, short_run(), *backend_);
  Trainer on_dirty(dirty, short_run(), *backend_);
  on_dirty.run();
  EXPECT_TRUE(same_bits(on_dirty.model(), of_clean));
  EXPECT_FALSE(same_bits(trained(short_run()), of_clean));             // masks do matter
  EXPECT_GT(gs::psnr_of(*backend_, on_dirty, dirty.train_views), 22);  // of trained pixels
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
  for (const float logit : gaussians_after(short_run()).logit_opacity)
    EXPECT_GE(sigmoid(logit), 1.0f / 255);
}

TEST_F(SmallRun, KeepsShDegreesThatWereNotReachedAtZero) {
  Config config = short_run();
  config.model.sh_degree = 0;
  const Gaussians gaussians = gaussians_after(config);
  for (std::size_t i = 0; i < gaussians.count(); ++i)
    EXPECT_TRUE(row_is(gaussians.sh_rest, i, 0.0f));
}

// ---- parts of a program's own --------------------------------------------------------------------

TEST_F(SmallRun, TakenStepByStepIsTheWholeRun) {
  Config config = short_run();
  config.train.iterations = 30;
  Trainer trainer(scene_, config, *backend_);
  trainer.begin();
  int steps = 1;
  while (trainer.take()) EXPECT_EQ(trainer.step(), steps++);
  trainer.end();
  EXPECT_TRUE(same_bits(trainer.model(), trained(config)));
}

TEST_F(SmallRun, WithALossOfItsOwnTrainsAsWithTheSameOfTheBackend) {
  Config config = short_run();
  config.loss.lambda_dssim = 0;
  config.train.iterations = 40;
  config.train.resolution_ramp = {2};
  config.train.resolution_least = 1;
  Trainer own(scene_, config, *backend_);
  std::vector<double> losses;
  backend_->use({.own_loss = {[&, l1 = l1_loss_in(host_memory())](const ComparedPicture& compared) {
                   losses.push_back(l1(compared));
                   return losses.back();
                 }}});
  own.run();
  const double psnr = psnr_of(own.model().gaussians, own.evaluation_settings());
  EXPECT_EQ(losses.size(), 40u);
  EXPECT_EQ(own.loss(), losses.back());
  EXPECT_NEAR(psnr, psnr_of(gaussians_after(config), own.evaluation_settings()), 0.2);
}

TEST_F(SmallRun, WithALossThatSeesDepthPullsBackAlphaAndDepthAsWell) {
  Config config = short_run();
  config.train.iterations = 40;
  config.density.from_step = 30000;
  const auto mean_alpha_after = [&](bool sees_depth) {
    Trainer trainer(scene_, config, *backend_);
    backend_->use({.own_loss = {l1_loss_in(host_memory()), sees_depth}});
    trainer.run();
    RenderPass pass(host_memory());
    backend_->renderer().forward(trainer.model().gaussians.span(), scene_.train_views[0].camera,
                                 trainer.evaluation_settings(), pass);
    double sum = 0;
    for (const float left : pass.transmittance) sum += 1 - double(left);
    return sum / double(pass.pixel_count());
  };
  EXPECT_LT(mean_alpha_after(true), 0.9 * mean_alpha_after(false));
}

TEST_F(SmallRun, CanTakeAStepAgainWhoseLossHasThrown) {
  Config config = short_run();
  config.train.iterations = 20;
  bool throws = false;
  const auto run = [&](int failing_step) {
    Trainer trainer(scene_, config, *backend_);
    backend_->use(
        {.own_loss = {[&, l1 = l1_loss_in(host_memory())](const ComparedPicture& compared) {
           if (throws) throw std::runtime_error("no loss");
           return l1(compared);
         }}});
    trainer.begin();
    for (bool goes_on = true; goes_on;) {
      throws = trainer.step() + 1 == failing_step;
      if (throws) {
        EXPECT_THROW(trainer.take(), std::runtime_error);
      }
      throws = false;
      goes_on = trainer.take();
    }
    trainer.end();
    return copy_to(host_memory(), trainer.model());
  };
  const TrainingModel plain = run(0);
  EXPECT_TRUE(same_bits(run(1), plain));
  EXPECT_TRUE(same_bits(run(11), plain));
}

/// Asks for absolute gradients, and says which steps it saw.
class WatchingControl final : public DensityControl {
 public:
  explicit WatchingControl(std::vector<int>& steps) : DensityControl(0), steps_(steps) {}
  DensityStep of_step(int) const override {
    return {.gather_statistics = true, .absolute_gradient = true};
  }
  RefineReport after_step(TrainingModel&, Backend&, int step) override {
    steps_.push_back(step);
    return {};
  }

 private:
  std::vector<int>& steps_;
};

TEST_F(SmallRun, IsControlledByTheProgramWhereItBringsItsOwnDensityControl) {
  Config config = short_run();
  config.train.iterations = 5;
  Trainer trainer(scene_, config, *backend_);
  std::vector<int> steps;
  trainer.control_density_by(std::make_unique<WatchingControl>(steps));
  trainer.begin();
  trainer.take();
  const std::vector<float> absolute = trainer.model().statistics.gradient_norm.download();
  config.density.strategy = "absgs";
  config.density.from_step = 0;
  Trainer like(scene_, config, *backend_);
  like.begin();
  like.take();
  EXPECT_EQ(absolute, like.model().statistics.gradient_norm.download());
  EXPECT_GT(absolute[0], 0);
  while (trainer.take()) {
  }
  EXPECT_THAT(steps, ElementsAre(1, 2, 3, 4, 5));
}

TEST(Trainer, ALossThatTheBackendLacksIsRefusedWhenARunIsMade) {
  const auto backend = make_scalar_backend();
  Config config = adaptive_config();
  config.loss.kind = "l2";
  EXPECT_THAT([&] { Trainer(small_scene(), config, *backend); },
              ThrowsMessage<UsageError>(HasSubstr("no loss.kind l2 on cpu; it is one of l1_ssim")));
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
