// SPDX-License-Identifier: Apache-2.0
// Models whose moments are HalfMoments (optimizer.moments): their updates, their row operations, and
// whole runs.
#include "gs_core/config/config_words.h"
#include "gs_core/math/update/moment_rounding.h"
#include "gs_train/initialize/initialize.h"
#include "gs_train/row_rules.h"
#include "tests/support/scene_run.h"

namespace gs {
namespace {

/// Row i has the moments numbered(1 + i).
TrainingModel numbered_model(std::size_t count) {
  TrainingModel model =
      model_of(random_gaussians(kTypical, count, random_camera(40, 30), 1), MomentStorage::halves);
  number_moments(model, 1);
  return model;
}

TEST(HalfMomentsOfAModel, TakeAQuarterOfTheBytes) {
  for (const MomentStorage storage : kMomentStorages) {
    const TrainingModel model =
        model_of(random_gaussians(kTypical, 10, random_camera(40, 30), 1), storage);
    std::size_t bytes = 0;
    for (const auto& column : model.columns()) bytes += column.rows->size_bytes();
    EXPECT_EQ(bytes / 10, storage == MomentStorage::halves ? 362u : 716u);
  }
}

TEST(HalfMomentsOfAModel, AreUpdatedNumberByNumberWithTheRandomNumbersOfTheirRows) {
  TrainingModel model =
      model_of(random_gaussians(kTypical, 700, random_camera(40, 30), 1), MomentStorage::halves);
  const Gaussians start = copy_of(model.gaussians);
  const Gaussians first = random_gradients(700, 2), second = random_gradients(700, 3);
  Update update{kRates};
  update.rounding_seed = 5;
  update_by_adam(model, first, update);
  update_by_adam(model, second, update);
  EXPECT_EQ(model.adam_steps, 2);

  for_each_array(
      [](const char* name, const auto& before, const auto& after, const auto& moments,
         const auto& g1, const auto& g2, float rate, int offset) {
        constexpr std::size_t kInRow = sizeof(before[0]) / sizeof(float);
        for (std::size_t i = 0; i < numbers_of(before).size; ++i) {
          const std::size_t row = i / kInRow;
          const int number = offset + int(i % kInRow);
          float value = numbers_of(before)[i];
          HalfMoments expected{};
          adam_update(value, expected, numbers_of(g1)[i], adam_step(1, rate), AdamRule(),
                      random_of_number(MomentRounding{5, 1}.of_row(row), number));
          adam_update(value, expected, numbers_of(g2)[i], adam_step(2, rate), AdamRule(),
                      random_of_number(MomentRounding{5, 2}.of_row(row), number));
          ASSERT_EQ(numbers_of(after)[i], value) << name << " " << i;
          ASSERT_EQ(moments_in(moments)[i].bits, expected.bits) << name << " " << i;
        }
      },
      start, model.gaussians, std::get<AdamMoments<HalfMoments>>(model.moments), first, second,
      kRates, kRandomOffsets);
}

// ---- rows --------------------------------------------------------------------------------------

TEST(HalfMomentsOfAModel, FollowTheirRowsAndStartAtZeroInNewOnes) {
  TrainingModel model = numbered_model(6);
  const std::uint32_t source[] = {4, 1, 1, 5};
  gather_rows(model.columns(), {source, 4});
  ASSERT_EQ(model.count(), 4u);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_TRUE(moments_are(model, i, source[i] + 1)) << i;
  start_new_rows(model.columns(), 2);
  for (std::size_t i = 0; i < 4; ++i)
    EXPECT_TRUE(moments_are(model, i, i < 2 ? source[i] + 1 : 0)) << i;
}

TEST(HalfMomentsOfAModel, OfRowsThatAreRelocatedBecomeZero) {
  TrainingModel model = numbered_model(3);
  for (std::size_t i = 0; i < 3; ++i)
    model.gaussians.logit_opacity[i] = i == 1 ? logit(0.5f) : logit(0.001f);
  make_scalar_row_ops()->relocate(model, {0.005f, 0}, 1, 600);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_TRUE(moments_are(model, i, 0)) << i;
}

TEST(HalfMomentsOfAModel, AreClearedAsTheOpacityRuleSays) {
  for (const MomentClearing which :
       {MomentClearing::none, MomentClearing::opacity, MomentClearing::all}) {
    TrainingModel model = numbered_model(3);
    make_scalar_row_ops()->lower_opacity(model, {OpacityPolicy::reset, 0.01f, which});
    const auto& moments = std::get<AdamMoments<HalfMoments>>(model.moments);
    EXPECT_EQ(moments_are(moments.logit_opacity, 2, 0), which != MomentClearing::none);
    EXPECT_EQ(moments_are(moments.logit_opacity, 2, 3), which == MomentClearing::none);
    EXPECT_EQ(moments_are(moments.sh_rest, 2, 0), which == MomentClearing::all);
    EXPECT_EQ(moments_are(moments.mean, 2, 3), which != MomentClearing::all);
  }
}

// ---- runs --------------------------------------------------------------------------------------

class HalfRun : public SceneRun {
 protected:
  HalfRun() : SceneRun(small_scene()) {}
  static Config with(MomentStorage storage, Config config) {
    config.optimizer.moments = storage;
    return config;
  }
  static Config busy_batches() {
    Config config = busy_run();
    config.train.batch = 3;
    return config;
  }
  /// The mean PSNR of some seeds.
  double mean_psnr(Config config) {
    constexpr int kSeeds = 6;
    double sum = 0;
    for (int seed = 1; seed <= kSeeds; ++seed) {
      config.train.seed = std::uint64_t(seed);
      sum += psnr_after(config) / kSeeds;
    }
    return sum;
  }
};

// Rounding makes another run of it, as another seed does.
TEST_F(HalfRun, EndsAsGoodAsWithFloats) {
  for (const Config& config : {short_run(), short_mcmc_run()}) {
    const double floats = mean_psnr(config);
    const double halves = mean_psnr(with(MomentStorage::halves, config));
    RecordProperty(config.density.strategy + "_" + std::string(word_of(MomentStorage::halves)),
                   std::to_string(halves - floats));
    EXPECT_NEAR(halves, floats, 0.3) << config.density.strategy;
  }
}

TEST_F(HalfRun, GivesTheSameBitsForAnyNumberOfThreads) {
  for (const Config& config :
       {with(MomentStorage::halves, busy_run()), with(MomentStorage::halves, busy_batches())})
    expect_same_bits_on_any_threads(config);
}

TEST_F(HalfRun, StoppedAndResumedEndsWithTheSameBits) {
  expect_goes_on_after({1, 43, 97}, with(MomentStorage::halves, busy_run()));
  expect_goes_on_after({43}, with(MomentStorage::halves, short_mcmc_run()));
  expect_goes_on_after({43}, with(MomentStorage::halves, busy_batches()));
}

TEST_F(HalfRun, RefusesAStateWithMomentsInAnotherStorage) {
  Config config = short_run();
  config.train.iterations = 10;
  for (const MomentStorage storage : kMomentStorages) {
    const TrainingState state = stopped_after(5, scene_, with(storage, config), *backend_);
    for (const MomentStorage other : kMomentStorages) {
      if (other == storage) continue;
      EXPECT_THAT(error_of([&] {
                    Trainer(scene_, with(other, config), *backend_, KeptStates::copy(state));
                  }),
                  AllOf(HasSubstr("set optimizer.moments=" + std::string(word_of(storage)) + ","),
                        HasSubstr("start a new run")));
    }
  }
}

}  // namespace
}  // namespace gs
