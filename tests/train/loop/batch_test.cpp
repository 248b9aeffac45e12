// SPDX-License-Identifier: Apache-2.0
// Steps of several photos, and runs in batches.
#include "tests/support/scene_run.h"

namespace gs {
namespace {

class BatchStep : public ::testing::Test {
 protected:
  /// The model after one step on some views.
  TrainingModel after(const std::vector<int>& views, const AdamRule& rule = {}) {
    std::vector<TrainingPhoto> batch;
    for (const int view : views) batch.push_back({&scene_.train_views[view], {}});
    TrainingModel model = model_of(small_truth());
    number_rows(model.gaussians.sh0, 0.1f);
    backend_->step(model, {{batch.data(), batch.size()}, {0.2f}, {kRates, rule}, {true}});
    return model;
  }

  const Scene scene_ = small_scene();
  const std::unique_ptr<Backend> backend_ = make_scalar_backend();
};

TEST_F(BatchStep, OfTheSamePhotoTwiceIsThatOfOnePhoto) {
  const TrainingModel once = after({3}), twice = after({3, 3});
  EXPECT_TRUE(same_bits(twice, once));
  for (std::size_t i = 0; i < once.count(); ++i) {
    EXPECT_EQ(twice.statistics.visits[i], 2 * once.statistics.visits[i]);
    EXPECT_EQ(twice.statistics.gradient_norm[i], 2 * once.statistics.gradient_norm[i]);
  }
}

// The first moment after the first step is a tenth of the gradient.
TEST_F(BatchStep, TakesTheMeanOfTheGradientsAndTheSumOfTheStatistics) {
  const TrainingModel a = after({1}), b = after({4}), c = after({6}), batch = after({1, 4, 6});
  for_each_array(
      [](const char* name, const auto& of_batch, const auto& of_a, const auto& of_b,
         const auto& of_c) {
        const Span<const float> mean = numbers_of(of_batch), x = numbers_of(of_a),
                                y = numbers_of(of_b), z = numbers_of(of_c);
        for (std::size_t i = 0; i < mean.size; ++i) {
          const float size = std::max({std::abs(x[i]), std::abs(y[i]), std::abs(z[i])});
          ASSERT_NEAR(mean[i], (x[i] + y[i] + z[i]) / 3, 1e-6f * size) << name << " " << i;
        }
      },
      opened(batch).first, opened(a).first, opened(b).first, opened(c).first);
  for (std::size_t i = 0; i < batch.count(); ++i) {
    EXPECT_EQ(batch.statistics.visits[i],
              a.statistics.visits[i] + b.statistics.visits[i] + c.statistics.visits[i]);
    EXPECT_NEAR(batch.statistics.gradient_norm[i],
                a.statistics.gradient_norm[i] + b.statistics.gradient_norm[i] +
                    c.statistics.gradient_norm[i],
                1e-5f * batch.statistics.gradient_norm[i]);
  }
}

TEST_F(BatchStep, HasADegreeOfShAndABackgroundForEachPhoto) {
  std::vector<TrainingPhoto> batch(2, {&scene_.train_views[0], {}});
  batch[1].settings.background = {1, 0, 0};
  TrainingModel model = model_of(small_truth()), other = model_of(small_truth());
  backend_->step(model, {{batch.data(), 2}, {0.2f}, {kRates}, {true}});
  batch[1].settings.background = batch[0].settings.background;
  backend_->step(other, {{batch.data(), 2}, {0.2f}, {kRates}, {true}});
  EXPECT_FALSE(same_bits(model, other));
}

TEST_F(BatchStep, CountsTheStepsForWhichItStands) {
  EXPECT_EQ(after({0, 1, 2, 3}).adam_steps, 1);
  EXPECT_EQ(after({0, 1, 2, 3}, batch_rule(4)).adam_steps, 4);
}

// ---- runs --------------------------------------------------------------------------------------

class BatchRun : public SceneRun {
 protected:
  BatchRun() : SceneRun(small_scene()) {}
  static Config run_of(int batch) {
    Config config = short_run();
    config.train.batch = batch;
    return config;
  }
};

TEST_F(BatchRun, BringsThePicturesCloseToThePhotos) {
  for (const int batch : {2, 4, 7}) {
    Trainer trainer(scene_, run_of(batch), *backend_);
    trainer.run();
    EXPECT_GT(psnr_of(*backend_, trainer, scene_.train_views), 21) << "batches of " << batch;
    EXPECT_EQ(trainer.model().adam_steps, 250);
  }
}

TEST_F(BatchRun, WithoutRatesOfItsOwnHasThoseOfOnePhoto) {
  Config config = run_of(5);
  config.train.batch_rates = false;
  EXPECT_EQ(trained(config).adam_steps, 50);
  EXPECT_FALSE(same_bits(trained(config), trained(run_of(5))));
}

TEST_F(BatchRun, GivesTheSameBitsForAnyNumberOfThreads) {
  Config config = run_of(4);
  config.train.iterations = 90;
  config.density.from_step = config.density.every = 20;
  config.render.background = Background::random;
  expect_same_bits_on_any_threads(config);
}

TEST_F(BatchRun, TellsItsObserversOfEveryStepOnceItsBatchIsTaken) {
  Config config = run_of(4);
  config.train.iterations = 10;
  std::vector<int> told, reached;
  After steps([&](int step, Trainer& trainer) {
    told.push_back(step);
    reached.push_back(trainer.step());
  });
  Trainer trainer(scene_, config, *backend_);
  trainer.add_observer(steps);
  trainer.run();
  EXPECT_EQ(told, (std::vector{1, 2, 3, 4, 5, 6, 7, 8, 9, 10}));
  EXPECT_EQ(reached, (std::vector{4, 4, 4, 4, 8, 8, 8, 8, 10, 10}));
  EXPECT_EQ(trainer.step(), 10);
}

// Refinements at step 20, 40, ... lie within batches of seven, and happen after these.
TEST_F(BatchRun, RefinesAsOftenAsWithoutBatches) {
  Config config = run_of(7);
  config.train.iterations = 120;
  config.density.from_step = config.density.every = 20;
  config.density.gradient_threshold = 1e-5f;
  EXPECT_GT(trained(config).count(), 2 * scene_.points.size());
}

}  // namespace
}  // namespace gs
