// SPDX-License-Identifier: Apache-2.0
// Models that keep Adam's moments as codes (optimizer.moments): their updates, their row
// operations, and whole runs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "gs_core/config/config_words.h"
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_train/initialize/initialize.h"
#include "gs_train/row_rules.h"
#include "tests/support/error_of.h"
#include "tests/support/scene_run.h"
#include "tests/support/small_scene.h"

namespace gs {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr LearningRates kRates{1e-4f, 2e-3f, 3e-3f, 4e-2f, 5e-3f, 6e-4f};

/// Row i has the codes `first` + i.
TrainingModel numbered_model(MomentForm form, std::size_t count, std::uint32_t first = 1) {
  TrainingModel model = model_of(random_gaussians(kTypical, count, random_camera(40, 30), 1), form);
  number_codes(model, first);
  return model;
}

TEST(CodedMoments, TakeFourOrTwoBytesOfANumber) {
  for (const MomentForm form : kMomentForms) {
    const TrainingModel model =
        model_of(random_gaussians(kTypical, 10, random_camera(40, 30), 1), form);
    std::size_t bytes = 0;
    for_each_row_array(
        [&](const RowArray&, const auto& array) { bytes += array.size() * sizeof(array[0]); },
        model);
    EXPECT_EQ(bytes / 10, form == MomentForm::tiny ? 362u : 716u);
    EXPECT_EQ(model.first_moment.count(), form == MomentForm::tiny ? 0u : 10u);
  }
}

TEST(CodedMoments, AreUpdatedNumberByNumberWithTheRandomNumbersOfTheirRows) {
  TrainingModel model =
      model_of(random_gaussians(kTypical, 700, random_camera(40, 30), 1), MomentForm::tiny);
  const Gaussians start = copy_of(model.gaussians);
  const Gaussians first = random_gradients(700, 2), second = random_gradients(700, 3);
  const auto optimizer = make_scalar_optimizer();
  Update update{kRates};
  update.rounding_seed = 5;
  optimizer->step(model, first, update);
  optimizer->step(model, second, update);
  EXPECT_EQ(model.adam_steps, 2);

  for_each_array(
      [](const char* name, const auto& before, const auto& after, const auto& codes, const auto& g1,
         const auto& g2, float rate, int place) {
        constexpr std::size_t kInRow = sizeof(before[0]) / sizeof(float);
        for (std::size_t i = 0; i < numbers_of(before).size; ++i) {
          const std::size_t row = i / kInRow;
          const int number = place + int(i % kInRow);
          float value = numbers_of(before)[i];
          TinyCode expected;
          adam_update(value, expected, numbers_of(g1)[i], adam_step(1, rate), AdamRule(),
                      random_of_number(MomentRounding{5, 1}.of_row(row), number));
          adam_update(value, expected, numbers_of(g2)[i], adam_step(2, rate), AdamRule(),
                      random_of_number(MomentRounding{5, 2}.of_row(row), number));
          ASSERT_EQ(numbers_of(after)[i], value) << name << " " << i;
          ASSERT_EQ(codes_of(codes)[i].bits, expected.bits) << name << " " << i;
        }
      },
      start, model.gaussians, model.codes, first, second, kRates, number_places());
}

// ---- rows --------------------------------------------------------------------------------------

TEST(CodedMoments, FollowTheirRowsAndStartAtZeroInNewOnes) {
  TrainingModel model = numbered_model(MomentForm::tiny, 6);
  const std::uint32_t source[] = {4, 1, 1, 5};
  gather_rows(model, {source, 4});
  ASSERT_EQ(model.count(), 4u);
  for (std::size_t i = 0; i < 4; ++i) EXPECT_TRUE(codes_are(model, i, source[i] + 1)) << i;
  start_new_rows(model, 2);
  for (std::size_t i = 0; i < 4; ++i)
    EXPECT_TRUE(codes_are(model, i, i < 2 ? source[i] + 1 : 0)) << i;
}

TEST(CodedMoments, OfRowsThatAreRelocatedBecomeZero) {
  TrainingModel model = numbered_model(MomentForm::tiny, 3);
  for (std::size_t i = 0; i < 3; ++i)
    model.gaussians.logit_opacity[i] = i == 1 ? logit(0.5f) : logit(0.001f);
  make_scalar_row_ops()->relocate(model, {0.005f, 0}, 1, 600);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_TRUE(codes_are(model, i, 0)) << i;
}

TEST(CodedMoments, AreClearedAsTheOpacityRuleSays) {
  for (const MomentClearing which :
       {MomentClearing::none, MomentClearing::opacity, MomentClearing::all}) {
    TrainingModel model = numbered_model(MomentForm::tiny, 3);
    make_scalar_row_ops()->lower_opacity(model, {OpacityPolicy::reset, 0.01f, which});
    const MomentCodes& codes = model.codes;
    EXPECT_EQ(codes_are(codes.logit_opacity, 2, 0), which != MomentClearing::none);
    EXPECT_EQ(codes_are(codes.logit_opacity, 2, 3), which == MomentClearing::none);
    EXPECT_EQ(codes_are(codes.sh_rest, 2, 0), which == MomentClearing::all);
    EXPECT_EQ(codes_are(codes.mean, 2, 3), which != MomentClearing::all);
  }
}

TEST(CodedMoments, AreCopiedBetweenMemories) {
  const TrainingModel model = numbered_model(MomentForm::tiny, 9);
  const TrainingModel copy = copy_to(host_memory(), model);
  EXPECT_EQ(copy.moment_form, MomentForm::tiny);
  EXPECT_TRUE(same_bits(copy, model));
}

// ---- runs --------------------------------------------------------------------------------------

class CodedRun : public SceneRun {
 protected:
  CodedRun() : SceneRun(small_scene()) {}
  static Config with(MomentForm form, Config config) {
    config.optimizer.moments = form;
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
TEST_F(CodedRun, EndsAsGoodAsWithFloats) {
  for (const Config& config : {short_run(), short_mcmc_run()}) {
    const double floats = mean_psnr(config);
    const double codes = mean_psnr(with(MomentForm::tiny, config));
    RecordProperty(config.density.strategy + "_" + std::string(word_of(MomentForm::tiny)),
                   std::to_string(codes - floats));
    EXPECT_NEAR(codes, floats, 0.3) << config.density.strategy;
  }
}

TEST_F(CodedRun, KeepsNoMomentsAsFloats) {
  Config config = with(MomentForm::tiny, short_run());
  config.train.iterations = 20;
  const TrainingModel model = trained(config);
  EXPECT_EQ(model.moment_form, MomentForm::tiny);
  EXPECT_TRUE(model.first_moment.mean.empty() && model.second_moment.sh_rest.empty());
  EXPECT_EQ(model.codes.sh_rest.size(), model.count());
}

TEST_F(CodedRun, GivesTheSameBitsForAnyNumberOfThreads) {
  for (const Config& config :
       {with(MomentForm::tiny, busy_run()), with(MomentForm::tiny, busy_batches())}) {
    set_thread_count(1);
    const TrainingModel one = trained(config);
    set_thread_count(0);
    EXPECT_TRUE(same_bits(trained(config), one));
  }
}

TEST_F(CodedRun, StoppedAndResumedEndsWithTheSameBits) {
  expect_goes_on_after({1, 43, 97}, with(MomentForm::tiny, busy_run()));
  expect_goes_on_after({43}, with(MomentForm::tiny, short_mcmc_run()));
  expect_goes_on_after({43}, with(MomentForm::tiny, busy_batches()));
}

TEST_F(CodedRun, RefusesAStateWithMomentsOfAnotherForm) {
  Config config = short_run();
  config.train.iterations = 10;
  for (const MomentForm form : kMomentForms) {
    LastState kept;
    StopAfter stopper(5);
    Trainer first(scene_, with(form, config), *backend_);
    first.keep_checkpoints_in(kept);
    first.add_observer(stopper);
    first.run();
    for (const MomentForm other : kMomentForms) {
      if (other == form) continue;
      EXPECT_THAT(
          error_of([&] { Trainer(scene_, with(other, config), *backend_, *kept.newest()); }),
          AllOf(HasSubstr("set optimizer.moments=" + std::string(word_of(form)) + ","),
                HasSubstr("start a new run")));
    }
  }
}

}  // namespace
}  // namespace gs
