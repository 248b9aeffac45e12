// SPDX-License-Identifier: Apache-2.0
// Runs whose Gaussians are dealt to ranks end in the bytes of one rank.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "gs_core/error.h"
#include "gs_core/random.h"
#include "gs_train/ranks/ranked_backend.h"
#include "tests/support/error_of.h"
#include "tests/support/same_bits.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

// Small chunks, so that a few dozen Gaussians lie on all ranks, in several chunks each.
std::unique_ptr<Backend> ranks_of(int count, double deadline = 30) {
  return make_ranked_backend({count, deadline, 5});
}

class RankedRun : public SceneRun {
 protected:
  RankedRun() : SceneRun(small_scene()) {}
  TrainingModel trained_by(Backend& backend, const Config& config) {
    return model_of_run(scene_, config, backend);
  }
  void expect_same_for_any_number(const Config& config) {
    const TrainingModel expected = trained(config);
    for (const int count : {1, 2, 3, 4, 16}) {
      const auto backend = ranks_of(count);
      EXPECT_TRUE(same_bits(trained_by(*backend, config), expected))
          << config.density.strategy << ", ranks: " << count;
    }
  }
  static Config run_in_batches(int batch, int steps = 90) {
    Config config = short_run();
    config.train.batch = batch;
    config.train.iterations = steps;
    config.density.from_step = config.density.every = 20;
    config.density.gradient_threshold = 1e-5f;
    config.render.background = Background::random;
    return config;
  }
  static Config mcmc_run(int batch) {
    Config config = run_in_batches(batch);
    config.density.strategy = "mcmc";
    config.density.max_gaussians = 80;
    config.density.opacity_regularizer = config.density.scale_regularizer = 0.01f;
    return config;
  }
  static Config lit_run(int batch) {
    Config config = run_in_batches(batch, 60);
    config.photometric.model = "gains";
    config.photometric.rate = 0.02f;
    return config;
  }
  static Config posed_run(int batch) {
    Config config = run_in_batches(batch, 60);
    config.poses.refine = true;
    config.poses.rate = 1e-3f;
    return config;
  }
  template <class Numbers>
  static bool has_learned(const Numbers& numbers) {
    return std::any_of(numbers.begin(), numbers.end(), [](float x) { return x != 0; });
  }
};

TEST_F(RankedRun, WithAdaptiveDensityControlHasTheBytesOfOneRank) {
  for (const int batch : {1, 4, 5}) expect_same_for_any_number(run_in_batches(batch));
}

TEST_F(RankedRun, WithMcmcHasTheBytesOfOneRank) {
  for (const int batch : {1, 4}) expect_same_for_any_number(mcmc_run(batch));
}

TEST_F(RankedRun, WithMomentsAsCodesHasTheBytesOfOneRank) {
  for (Config config : {run_in_batches(4), mcmc_run(1)}) {
    config.optimizer.moments = MomentStorage::halves;
    expect_same_for_any_number(config);
  }
}

TEST_F(RankedRun, WithABudgetHasTheBytesOfOneRank) {
  for (const int batch : {1, 4}) {
    Config config = busy_run();
    config.train.batch = batch;
    expect_same_for_any_number(config);
  }
}

TEST_F(RankedRun, WithScoresOfPixelsAndReducedPhotosHasTheBytesOfOneRank) {
  Config config = busy_run();
  config.train.batch = 3;
  config.train.resolution_ramp = {2};
  config.train.resolution_least = 1;
  config.density.strategy = "taming";
  expect_same_for_any_number(config);
}

TEST_F(RankedRun, WithTheFilterHasTheBytesOfOneRank) {
  Config config = run_in_batches(4);
  config.model.filter_3d = true;
  expect_same_for_any_number(config);
}

TEST_F(RankedRun, InSpaceAndTimeHasTheBytesOfOneRank) {
  Config config = run_in_batches(3, 60);
  config.model.dynamic = true;
  expect_same_for_any_number(config);
}

TEST_F(RankedRun, WithAPhotometricModelHasTheBytesOfOneRank) {
  for (const int batch : {1, 4}) expect_same_for_any_number(lit_run(batch));
  EXPECT_TRUE(has_learned(trained(lit_run(4)).photometric.values));
}

TEST_F(RankedRun, WithRefinedPosesHasTheBytesOfOneRank) {
  for (const int batch : {1, 4}) expect_same_for_any_number(posed_run(batch));
  EXPECT_TRUE(has_learned(trained(posed_run(4)).poses.values));
}

TEST_F(RankedRun, LogsTheLossOfOneRank) {
  const Config config = run_in_batches(4, 30);
  const auto backend = ranks_of(3);
  Trainer one(scene_, config, *backend_), ranked(scene_, config, *backend);
  one.run();
  ranked.run();
  EXPECT_EQ(ranked.loss(), one.loss());
}

// ---- resumed -----------------------------------------------------------------------------------

// Stopped at random steps, and each time resumed with another number of ranks.
TEST_F(RankedRun, GoesOnWithAnyNumberOfRanksFromAnyCheckpoint) {
  const Random random{7, RandomStream::background};
  Config lit_and_posed = posed_run(3);
  lit_and_posed.photometric = lit_run(3).photometric;
  for (const Config& config : {run_in_batches(4), mcmc_run(3), busy_run(), lit_and_posed}) {
    const TrainingModel expected = trained(config);
    for (std::uint64_t attempt = 0; attempt < 7; ++attempt) {
      const Vec4f draw = random.uniform4(attempt);
      const int stop = 1 + int(draw.x * float(config.train.iterations - 1));
      const auto first = ranks_of(1 + int(4 * draw.y)), second = ranks_of(1 + int(4 * draw.z));
      LastState kept;
      StopAfter stopper(stop);
      Trainer stopped(scene_, config, *first);
      stopped.keep_checkpoints_in(kept);
      stopped.add_observer(stopper);
      stopped.run();
      Trainer resumed(scene_, config, *second, *kept.newest());
      resumed.run();
      EXPECT_TRUE(same_bits(resumed.model(), expected))
          << config.density.strategy << " after step " << stop << ", " << first->name() << ", then "
          << second->name();
    }
  }
}

TEST_F(RankedRun, WritesTheCheckpointOfOneRank) {
  const Config config = run_in_batches(4);
  LastState of_one, of_three;
  const auto three = ranks_of(3);
  for (auto [kept, backend] : {std::pair{&of_one, backend_.get()}, {&of_three, three.get()}}) {
    StopAfter stopper(50);
    Trainer trainer(scene_, config, *backend);
    trainer.keep_checkpoints_in(*kept);
    trainer.add_observer(stopper);
    trainer.run();
  }
  EXPECT_EQ(of_three.state.model.adam_steps, of_one.state.model.adam_steps);
  EXPECT_EQ(of_three.state.progress.loss, of_one.state.progress.loss);
  for_each_row_array([](const RowArray& which, const auto& a,
                        const auto& b) { EXPECT_TRUE(same_bits(a, b)) << which.key(); },
                     of_three.state.model, of_one.state.model);
}

// ---- failures ----------------------------------------------------------------------------------

/// The photos of some views; from the third request for photo 2 on, `at_third` is called first.
class FailingPhotos final : public PhotoSource {
 public:
  FailingPhotos(std::vector<View> views, std::function<void()> at_third)
      : views_(std::move(views)), at_third_(std::move(at_third)) {}
  std::shared_ptr<const View> view(std::size_t index) override {
    if (index == 2 && ++requests_ >= 3) at_third_();
    return std::make_shared<View>(views_[index]);
  }
  void prefetch_decode(std::size_t) override {}
  void release(std::size_t) override {}

 private:
  const std::vector<View> views_;
  const std::function<void()> at_third_;
  std::atomic<int> requests_{0};
};

Scene scene_of(const std::shared_ptr<PhotoSource>& photos) {
  Scene scene = small_scene();
  for (std::size_t i = 0; i < scene.train_views.size(); ++i) {
    scene.train_views[i].photo = {};
    scene.train_views[i].source = photos;
    scene.train_views[i].index = i;
  }
  return scene;
}

TEST_F(RankedRun, EndsWithOneMessageWhereARankThrows) {
  const auto photos = std::make_shared<FailingPhotos>(scene_.train_views, [] {
    throw Error("cannot read view 2: it is damaged", ExitCode::bad_data);
  });
  const Scene scene = scene_of(photos);
  const auto backend = ranks_of(3);
  LastState kept;
  Config config = run_in_batches(4);
  config.train.checkpoint_every = 4;
  Trainer trainer(scene, config, *backend);
  trainer.keep_checkpoints_in(kept);
  EXPECT_THAT(error_of([&] { trainer.run(); }),
              AllOf(HasSubstr("rank "), HasSubstr(": cannot read view 2: it is damaged")));
  // The last checkpoint stands, and any number of ranks goes on from it.
  ASSERT_GT(kept.state.progress.step, 0);
  const auto two = ranks_of(2);
  Trainer resumed(scene_, config, *two, *kept.newest());
  resumed.run();
  EXPECT_TRUE(same_bits(resumed.model(), trained(config)));
}

TEST_F(RankedRun, EndsWithinTheDeadlineWhereARankHangs) {
  const auto let_go = std::make_shared<std::promise<void>>();
  const auto has_ended = std::make_shared<std::promise<void>>();
  const auto photos = std::make_shared<FailingPhotos>(scene_.train_views, [=] {
    let_go->get_future().wait();
    has_ended->set_value();
    throw Error("too late");
  });
  const Scene scene = scene_of(photos);
  const auto backend = ranks_of(2, 0.5);
  Trainer trainer(scene, run_in_batches(4), *backend);
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_THAT(error_of([&] { trainer.run(); }),
              AllOf(HasSubstr("rank "), HasSubstr(": no sign of life for 0.5 s")));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(10));
  // Nothing reads the shards while the thread may still write to them.
  EXPECT_THAT(error_of([&] { trainer.model(); }), HasSubstr("--resume"));
  let_go->set_value();
  has_ended->get_future().wait();
}

// ---- steps -------------------------------------------------------------------------------------

std::atomic<int> allocations_left{0};  // until one fails

void fail_once(std::size_t) {
  if (--allocations_left == 0) throw Error("no memory, says the test", ExitCode::out_of_memory);
}

/// One step by four photos, with all that density control may add to it.
void take_step(Backend& backend, TrainingModel& model, const Scene& scene) {
  constexpr LearningRates kRates{1e-4f, 2e-3f, 3e-3f, 4e-2f, 5e-3f, 6e-4f};
  std::vector<TrainingPhoto> batch;
  for (const View& view : scene.train_views) batch.push_back({&view, {}});
  DensityStep density{.gather_statistics = true, .regularizers = {0.01f, 0.01f}};
  density.noise = {1e3f, {3, RandomStream::position_noise}, 5};
  density.score = GrowthScore::force;
  backend.step(model, {batch.data(), 4}, {0.2f}, Update{kRates}, density);
}

TrainingModel first_model() {
  TrainingModel model;
  model.gaussians = small_truth();
  clear_history(model);
  return model;
}

TEST(RankedStep, ThatRunsOutOfMemoryAnywhereChangesNothingAndCanBeRepeated) {
  const Scene scene = small_scene();
  TrainingModel expected = first_model();
  take_step(*make_scalar_backend(), expected, scene);
  int failures = 0;
  for (int k = 1;; ++k) {
    TrainingModel model = first_model();
    const auto backend = ranks_of(3);
    allocations_left = k;
    set_allocation_hook(fail_once);
    bool has_failed = false;
    try {
      take_step(*backend, model, scene);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ExitCode::out_of_memory) << error.what();
      has_failed = true;
    }
    set_allocation_hook(nullptr);
    if (!has_failed) break;
    ++failures;
    take_step(*backend, model, scene);
    backend->synchronize(model);
    for_each_row_array(
        [&](const RowArray& which, const auto& a, const auto& b) {
          EXPECT_TRUE(same_bits(a, b)) << which.key() << ", allocation " << k;
        },
        expected, model);
  }
  EXPECT_GT(failures, 100);
}

TEST(RankedStep, CountsRowsThatAreNotFiniteWhereverTheyAre) {
  const Scene scene = small_scene();
  TrainingModel model = first_model();
  const auto backend = ranks_of(4);
  model.gaussians.log_scale[17].y = std::numeric_limits<float>::infinity();
  EXPECT_EQ(backend->rows().count_not_finite(model), 1u);
  take_step(*backend, model, scene);
  EXPECT_EQ(backend->rows().count_not_finite(model), 1u);
}

}  // namespace
}  // namespace gs
