// SPDX-License-Identifier: Apache-2.0
// Models whose SH is updated lazily (optimizer.lazy): updates against those of all rows at once,
// looks at the model, row operations, and whole runs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/loop/lazy_choice.h"
#include "gs_train/ranks/ranked_backend.h"
#include "gs_train/stages/scalar_backend.h"
#include "tests/support/error_of.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

using ::testing::HasSubstr;

constexpr LearningRates kRates{1e-4f, 2e-3f, 3e-3f, 4e-2f, 5e-3f, 6e-4f};
constexpr std::size_t kRows = 300;

TrainingModel lazy_model(MomentForm form = MomentForm::floats) {
  TrainingModel model = model_of(random_gaussians(kTypical, kRows, random_camera(40, 30), 1), form);
  begin_lazy(model, 5);
  return model;
}

/// One update in which a share of the rows is seen. Rows that are not seen have no gradients of SH.
struct SomeSeen {
  std::vector<std::uint8_t> seen;
  Gaussians gradients;

  SomeSeen(std::uint64_t seed, float share)
      : seen(kRows), gradients(random_gradients(kRows, seed)) {
    Draws draws(seed + 1000);
    for (std::size_t i = 0; i < kRows; ++i) {
      seen[i] = draws.chance(share);
      if (!seen[i])
        for_each_lazy_array([&](LazyQuantity, auto& array) { array[i] = {}; }, gradients);
    }
  }
  Update update(int t) const {
    Update update{kRates};
    update.rates.sh0 *= std::exp(-0.01f * float(t));
    update.rounding_seed = 5;
    update.seen = {seen.data(), seen.size()};
    return update;
  }
};

/// The largest difference of any number, relative to the larger of `scale` and the number.
double largest_difference(const Gaussians& a, const Gaussians& b, double scale) {
  double largest = 0;
  for_each_array(
      [&](const char*, const auto& x, const auto& y) {
        for (std::size_t i = 0; i < numbers_of(x).size; ++i) {
          const double expected = numbers_of(y)[i];
          largest = std::max(
              largest, std::abs(numbers_of(x)[i] - expected) / std::max(scale, std::abs(expected)));
        }
      },
      a, b);
  return largest;
}

TEST(LazyUpdates, AreThoseOfAllRowsOnceTheyHaveCaughtUp) {
  for (const float share : {0.02f, 0.3f, 1.0f}) {
    TrainingModel lazy = lazy_model(), prompt = model_of(lazy.gaussians);
    const auto optimizer = make_scalar_optimizer();
    for (int t = 1; t <= 200; ++t) {
      const SomeSeen some(std::uint64_t(t), share);
      optimizer->step(lazy, some.gradients, some.update(t));
      optimizer->step(prompt, some.gradients, some.update(t));
    }
    make_scalar_row_ops()->catch_up(lazy);
    EXPECT_EQ(lazy.lazy.updates, 0);
    EXPECT_EQ(lazy.adam_steps, prompt.adam_steps);
    EXPECT_LT(largest_difference(lazy.gaussians, prompt.gaussians, 1), 2e-6) << share;
    for_each_lazy_array(
        [&](LazyQuantity, const auto& of_lazy, const auto& of_prompt, const auto& of_v) {
          const Span<float> m = numbers_of(of_lazy), expected = numbers_of(of_prompt),
                            v = numbers_of(of_v);
          for (std::size_t i = 0; i < m.size; ++i)
            ASSERT_NEAR(m[i], expected[i], 1e-5 * std::sqrt(v[i])) << share << " " << i;
        },
        lazy.first_moment, prompt.first_moment, prompt.second_moment);
    EXPECT_LT(largest_difference(lazy.second_moment, prompt.second_moment, 1e-30), 3e-5) << share;
  }
}

TEST(LazyUpdates, LeaveRowsAloneThatNobodySees) {
  TrainingModel model = lazy_model();
  const auto optimizer = make_scalar_optimizer();
  const SomeSeen first(1, 1), second(2, 0.5f);
  optimizer->step(model, first.gradients, first.update(1));
  const Gaussians before = copy_of(model.gaussians);
  optimizer->step(model, second.gradients, second.update(2));
  for (std::size_t i = 0; i < kRows; ++i) {
    EXPECT_EQ(model.gaussians.sh0[i] == before.sh0[i], !second.seen[i]) << i;
    EXPECT_EQ(model.lazy.updated_at[i], second.seen[i] ? 2u : 1u) << i;
    EXPECT_FALSE(model.gaussians.mean[i] == before.mean[i]) << i;
  }
}

// All rows catch up when the table is full, so that it never overflows.
TEST(LazyUpdates, CatchUpWhenTheTableIsFull) {
  TrainingModel lazy = lazy_model(), prompt = model_of(lazy.gaussians);
  const auto optimizer = make_scalar_optimizer();
  for (int t = 1; t <= kLazyWindow + 10; ++t) {
    const SomeSeen some(std::uint64_t(t), t == 1 ? 1.0f : 0.01f);
    optimizer->step(lazy, some.gradients, some.update(t));
    optimizer->step(prompt, some.gradients, some.update(t));
    EXPECT_EQ(lazy.lazy.updates, t % kLazyWindow);
  }
  make_scalar_row_ops()->catch_up(lazy);
  EXPECT_LT(largest_difference(lazy.gaussians, prompt.gaussians, 1), 1e-5);
}

// Codes are rounded once for all updates that a row has missed. That is right on average, too, but
// that steps of tiny codes are a little longer.
TEST(LazyUpdates, OfCodesAreRightOnAverage) {
  constexpr int kRuns = 40;
  TrainingModel exact = lazy_model();
  const auto optimizer = make_scalar_optimizer();
  const auto rows = make_scalar_row_ops();
  const Gaussians start = copy_of(exact.gaussians);
  const auto train = [&](TrainingModel& model, std::uint64_t seed) {
    for (int t = 1; t <= 60; ++t) {
      const SomeSeen some(std::uint64_t(t), t == 1 ? 1.0f : 0.1f);
      Update update = some.update(t);
      update.rounding_seed = seed;
      optimizer->step(model, some.gradients, update);
    }
    rows->catch_up(model);
  };
  train(exact, 0);
  for (const MomentForm form : kCodeForms) {
    double sum = 0, squares = 0, moved = 0;
    for (int run = 0; run < kRuns; ++run) {
      TrainingModel model = lazy_model(form);
      train(model, std::uint64_t(run) + 1);
      for (std::size_t i = 0; i < kRows; ++i)
        for (int c = 0; c < 3; ++c) {
          const double way = exact.gaussians.sh0[i][c] - start.sh0[i][c];
          const double error = model.gaussians.sh0[i][c] - exact.gaussians.sh0[i][c];
          sum += way > 0 ? error : -error;
          squares += error * error;
          moved += std::abs(way);
        }
    }
    const double count = double(kRuns) * kRows * 3;
    const double noise = std::sqrt(squares / count) / (moved / count);
    RecordProperty("noise_" + std::string(word_of(form)), std::to_string(noise));
    RecordProperty("mean_" + std::string(word_of(form)), std::to_string(sum / moved));
    const bool is_tiny = form == MomentForm::tiny;
    EXPECT_GT(noise, 0);
    EXPECT_LT(noise, is_tiny ? 0.12 : 0.03);
    EXPECT_LT(std::abs(sum), (is_tiny ? 0.01 : 1e-3) * moved);
  }
}

TEST(LazyUpdates, AreShownWithoutBeingMade) {
  for (const MomentForm form : kMomentForms) {
    TrainingModel model = lazy_model(form);
    const auto optimizer = make_scalar_optimizer();
    const auto rows = make_scalar_row_ops();
    for (int t = 1; t <= 20; ++t) {
      const SomeSeen some(std::uint64_t(t), 0.2f);
      optimizer->step(model, some.gradients, some.update(t));
    }
    const TrainingModel before = copy_to(host_memory(), model);
    Gaussians shown;
    {
      const CurrentSh current(model, *rows);
      shown = copy_of(model.gaussians);
    }
    EXPECT_TRUE(same_bits(model, before));
    EXPECT_FALSE(same_bits(shown.sh0, before.gaussians.sh0));
    rows->catch_up(model);
    EXPECT_TRUE(same_bits(shown, model.gaussians));
  }
}

// Every operation that moves rows or changes moments finds them up to date.
TEST(LazyUpdates, AreMadeBeforeRowsMove) {
  const auto optimizer = make_scalar_optimizer();
  const auto rows = make_scalar_row_ops();
  const auto expect_caught_up = [&](const char* what, auto&& operation) {
    TrainingModel model = lazy_model();
    for (int t = 1; t <= 5; ++t) {
      const SomeSeen some(std::uint64_t(t), 0.2f);
      optimizer->step(model, some.gradients, some.update(t));
    }
    operation(model);
    EXPECT_EQ(model.lazy.updates, 0) << what;
    EXPECT_EQ(model.lazy.updated_at.size(), model.count()) << what;
    for (const std::uint32_t update : model.lazy.updated_at) EXPECT_EQ(update, 0u) << what;
  };
  expect_caught_up("morton", [&](TrainingModel& model) { rows->sort_by_morton(model); });
  expect_caught_up("prune", [&](TrainingModel& model) { rows->prune(model, 0.005f); });
  expect_caught_up(
      "share", [&](TrainingModel& model) { rows->prune_share(model, PruneOrder::opacity, 0.1); });
  expect_caught_up("opacity", [&](TrainingModel& model) {
    rows->lower_opacity(model, {OpacityPolicy::reset, 0.01f, MomentClearing::all});
  });
  expect_caught_up("relocate", [&](TrainingModel& model) {
    rows->relocate(model, {0.05f, std::int64_t(kRows) + 20}, 1, 600);
  });
  expect_caught_up("refine", [&](TrainingModel& model) {
    rows->refine(model, AdaptiveRules{}, {1, RandomStream::split_gaussians}, 600);
  });
}

// ---- the choice --------------------------------------------------------------------------------

TEST(LazyChoice, CountsTheBytesOfAnUpdate) {
  const Gaussians arrays;
  EXPECT_DOUBLE_EQ(prompt_update_bytes(arrays, MomentForm::floats), 1416);
  EXPECT_DOUBLE_EQ(prompt_update_bytes(arrays, MomentForm::compact), 944);
  EXPECT_DOUBLE_EQ(prompt_update_bytes(arrays, MomentForm::tiny), 708);
  const auto lazy_bytes = [&](MomentForm form) {
    return lazy_update_bytes(arrays, form, {0.5, 0.5, 1});
  };
  EXPECT_DOUBLE_EQ(lazy_bytes(MomentForm::floats), 272 + 0.5 * 1536);
  EXPECT_DOUBLE_EQ(lazy_bytes(MomentForm::compact), 184 + 0.5 * 960);
  EXPECT_DOUBLE_EQ(lazy_bytes(MomentForm::tiny), 140 + 0.5 * 672);
  // 4 photos, which see 80 % of the rows together
  EXPECT_DOUBLE_EQ(lazy_update_bytes(arrays, MomentForm::floats, {0.8, 1.2, 4}),
                   272 + 0.8 * 1152 + 2.4 * 384);
}

// ---- runs --------------------------------------------------------------------------------------

class LazyRun : public SceneRun {
 protected:
  LazyRun() : SceneRun(scene_of_two_halves()) {}
  static Config lazily(Config config, LazyMode mode = LazyMode::on) {
    config.optimizer.lazy = mode;
    return config;
  }
  static Config batches(Config config) {
    config.train.batch = 3;
    return config;
  }
  static Config with(MomentForm form, Config config) {
    config.optimizer.moments = form;
    return config;
  }
};

TEST_F(LazyRun, EndsWithAllRowsUpToDate) {
  const TrainingModel model = trained(lazily(busy_run()));
  EXPECT_FALSE(model.lazy.is_on);
  EXPECT_TRUE(model.lazy.updated_at.empty());
}

TEST_F(LazyRun, EndsAsGoodAsWithoutIt) {
  for (const Config& config : {short_run(), short_mcmc_run(), batches(short_run())})
    EXPECT_NEAR(psnr_after(lazily(config)), psnr_after(config), 0.3) << config.density.strategy;
}

TEST_F(LazyRun, GivesTheSameBitsForAnyNumberOfThreads) {
  for (const Config& config :
       {lazily(busy_run()), lazily(batches(with(MomentForm::compact, busy_run()))),
        lazily(batches(with(MomentForm::tiny, busy_run())))}) {
    set_thread_count(1);
    const TrainingModel one = trained(config);
    set_thread_count(0);
    EXPECT_TRUE(same_bits(trained(config), one));
  }
}

TEST_F(LazyRun, StoppedAndResumedEndsWithTheSameBits) {
  expect_goes_on_after({1, 43, 97}, lazily(busy_run()));
  expect_goes_on_after({43}, lazily(short_mcmc_run()));
  expect_goes_on_after({43}, lazily(batches(busy_run())));
  for (const MomentForm form : kCodeForms)
    expect_goes_on_after({43, 97}, lazily(with(form, busy_run())));
}

/// Copies the result of every step.
class LookAtEachStep final : public Observer {
 public:
  void after_step(int, Trainer& trainer) override { copied_model(trainer); }
};

TEST_F(LazyRun, IsNotChangedByLooks) {
  const TrainingModel expected = trained(lazily(busy_run()));
  LookAtEachStep looks;
  Trainer trainer(scene_, lazily(busy_run()), *backend_);
  trainer.add_observer(looks);
  trainer.run();
  EXPECT_TRUE(same_bits(trainer.model(), expected));
}

/// Notes since when updates are left for later, and how many rows are late in the mean afterwards.
class NoteLazy final : public Observer {
 public:
  void after_step(int step, Trainer& trainer) override {
    const LazyState& lazy = trainer.model().lazy;
    if (!lazy.is_on) return;
    if (!first) first = step;
    for (const std::uint32_t at : lazy.updated_at) late += at < std::uint32_t(lazy.updates);
    rows += double(lazy.updated_at.size());
  }
  int first = 0;
  double late = 0, rows = 0;
};

/// Chooses as a GPU does.
class BoundByMemory final : public ScalarBackend {
 public:
  bool has_updates_bound_by_memory() const override { return true; }
};

TEST_F(LazyRun, ByItselfStaysPromptWherePhotosSeeAll) {
  BoundByMemory backend;
  NoteLazy note;
  const Scene scene = small_scene();
  Trainer trainer(scene, lazily(busy_run(), LazyMode::automatic), backend);
  trainer.add_observer(note);
  trainer.run();
  EXPECT_EQ(note.first, 0);
}

TEST_F(LazyRun, ByItselfStaysPromptOnACpu) {
  NoteLazy note;
  Trainer trainer(scene_, lazily(busy_run(), LazyMode::automatic), *backend_);
  trainer.add_observer(note);
  trainer.run();
  EXPECT_EQ(note.first, 0);
}

TEST_F(LazyRun, BeginsByItselfWherePhotosSeeAPart) {
  BoundByMemory backend;
  NoteLazy note;
  Trainer trainer(scene_, lazily(busy_run(), LazyMode::automatic), backend);
  trainer.add_observer(note);
  trainer.run();
  EXPECT_EQ(note.first, 13);  // a tenth of the run
  EXPECT_NEAR(note.late / note.rows, 0.5, 0.1);
}

TEST_F(LazyRun, StoppedBeforeAndAfterItsChoiceEndsWithTheSameBits) {
  BoundByMemory backend;
  const Config config = lazily(busy_run(), LazyMode::automatic);
  Trainer whole(scene_, config, backend);
  whole.run();
  const TrainingModel expected = copy_to(host_memory(), whole.model());
  for (const int stop : {3, 13, 97})
    EXPECT_TRUE(same_bits(resumed_after(stop, scene_, config, backend), expected)) << stop;
}

// Last bits differ, and then all that follows from them; so the runs are short.
TEST_F(LazyRun, FollowsTheRunWithoutIt) {
  for (Config config : {short_run(), batches(short_run())}) {
    config.train.iterations = 30;
    config.density.from_step = 30000;
    const TrainingModel lazy = trained(lazily(config)), prompt = trained(config);
    ASSERT_EQ(lazy.count(), prompt.count());
    EXPECT_FALSE(same_bits(lazy.gaussians, prompt.gaussians));
    EXPECT_LT(largest_difference(lazy.gaussians, prompt.gaussians, 1), 1e-4);
  }
}

TEST_F(LazyRun, RefusesRanksAndRefinedPoses) {
  Config config = lazily(short_run());
  const auto ranked = make_ranked_backend({2});
  EXPECT_THAT(error_of([&] { Trainer(scene_, config, *ranked); }), HasSubstr("train.ranks=1"));
  config.poses.refine = true;
  EXPECT_THAT(error_of([&] { Trainer(scene_, config, *backend_); }), HasSubstr("poses.refine"));
}

}  // namespace
}  // namespace gs
