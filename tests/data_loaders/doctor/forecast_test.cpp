// SPDX-License-Identifier: Apache-2.0
#include "data_loaders/doctor/forecast.h"

#include <gmock/gmock.h>

#include "tests/support/adaptive.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

TEST(Forecast, GrowsWithThePointsOfTheSceneUpToTheCap) {
  Config config = adaptive_config();
  EXPECT_NEAR(expected_gaussians(config, 9000), 215e3, 20e3);    // fox_640: 215,465
  EXPECT_NEAR(expected_gaussians(config, 33485), 909e3, 100e3);  // south_building: 908,930
  EXPECT_EQ(expected_gaussians(config, 1500000), 3000000);       // starts beyond a million
  config.train.iterations = 200;
  EXPECT_EQ(expected_gaussians(config, 9000), 9000);  // ends before the first growth
  config = adaptive_config();
  config.density.max_gaussians = 50000;
  EXPECT_EQ(expected_gaussians(config, 9000), 50000);
  EXPECT_EQ(expected_gaussians(config, 90000), 50000);
  config.density.strategy = "mcmc";
  EXPECT_EQ(expected_gaussians(config, 100), 50000);
  config.density.strategy = "growth";
  EXPECT_EQ(expected_gaussians(config, 100), 50000);
  config.density.strategy = "fastgs";  // no curve
  EXPECT_LT(expected_gaussians(config, 100), 50000);
}

TEST(Forecast, CountsAllGaussiansOfAModelToStartFrom) {
  Config config = adaptive_config();
  EXPECT_EQ(expected_gaussians_from_model(config, 1'500'000), 3'000'000);
  EXPECT_EQ(expected_gaussians_from_model(config, 20'000'000), 40'000'000);  // above kMostPoints
  EXPECT_EQ(expected_gaussians_from_model(config, 0), 0);
  config.density.max_gaussians = 50'000;
  EXPECT_EQ(expected_gaussians_from_model(config, 9000), 50'000);
  EXPECT_EQ(expected_gaussians_from_model(config, 90'000), 90'000);
  SceneSize scene = {0, 0, 1.0, 1000};
  scene.start = 90'000;
  EXPECT_THAT(forecast(config, scene, {}).text, HasSubstr("about 90,000 Gaussians"));
}

TEST(Forecast, NamesGpuFiguresForAGpuOnly) {
  const Config config = adaptive_config();
  const SceneSize scene = {1e8, 0, 1.0, 30000};
  EXPECT_THAT(forecast(config, scene, {}).text,
              AllOf(HasSubstr("on the CPU"), Not(HasSubstr("H200")), Not(HasSubstr("GPU"))));
  const Forecast on_gpu = forecast(config, scene, {true, std::size_t(80) << 30});
  EXPECT_THAT(on_gpu.text, AllOf(HasSubstr("80.0 GiB are free"), HasSubstr("on an H200")));
  EXPECT_THAT(on_gpu.warnings, IsEmpty());
}

// 59 parameters take 6 bytes less each: of 10 million Gaussians 354 of 472 bytes are 3.3 GiB.
TEST(Forecast, CountsTheBytesOfHalfMoments) {
  Config config = adaptive_config();
  config.optimizer.moments = MomentStorage::floats;
  config.density.strategy = "mcmc";
  config.density.max_gaussians = 10'000'000;
  const SceneSize scene = {0, 0, 1.0, 30000};
  const ForecastDevice gpu{true, std::size_t(80) << 30};
  EXPECT_THAT(forecast(config, scene, gpu).text, HasSubstr("training takes about 8.5 GiB"));
  config.optimizer.moments = MomentStorage::halves;
  EXPECT_THAT(forecast(config, scene, gpu).text, HasSubstr("training takes about 5.2 GiB"));
}

TEST(Forecast, WarnsOfARunThatDoesNotFit) {
  Config config = adaptive_config();
  config.density.max_gaussians = 10000000;
  config.density.strategy = "mcmc";
  const SceneSize scene = {1e8, 1e8, 1.0, 30000};
  const Forecast on_gpu = forecast(config, scene, {true, std::size_t(4) << 30});
  ASSERT_EQ(on_gpu.warnings.size(), 1u);
  EXPECT_THAT(on_gpu.warnings[0],
              AllOf(HasSubstr("the GPU has 4.0 GiB free"), HasSubstr("--max-gaussians 6")));

  config.density.max_gaussians = std::int64_t(1) << 40;  // 2 PiB
  const Forecast on_cpu = forecast(config, scene, {});
  ASSERT_EQ(on_cpu.warnings.size(), 1u);
  EXPECT_THAT(on_cpu.warnings[0],
              AllOf(HasSubstr("of RAM are free"), HasSubstr("--max-gaussians")));
}

TEST(Blocks, AreAdvisedWhereOneRunDoesNotHoldTheScene) {
  Config config = adaptive_config();
  const ForecastDevice device = {true, std::size_t(24) << 30};  // some 40 million Gaussians
  SceneSize scene = {1e8, 0, 1.0, 30'000};
  EXPECT_EQ(advice_on_blocks(config, scene, device).blocks, 1u);
  EXPECT_THAT(advice_on_blocks(config, scene, device).text, HasSubstr("one run holds"));
  scene.points = 40'000'000;  // more than kMostPoints, which limits one run alone
  const BlockAdvice advice = advice_on_blocks(config, scene, device);
  EXPECT_GE(advice.blocks, 3u);
  EXPECT_LE(advice.blocks, 6u);
  EXPECT_THAT(advice.text, HasSubstr("--blocks " + std::to_string(advice.blocks)));
  config.density.max_gaussians = 5'000'000;  // who limits the scene asks for no more
  EXPECT_EQ(advice_on_blocks(config, scene, device).blocks, 1u);
  EXPECT_THAT(advice_on_blocks(config, scene, {true, 0}).text, IsEmpty());
}

TEST(Blocks, ACapByPointsCounts) {
  Config config;
  config.density.gaussians_per_point = 30;
  const ForecastDevice device = {true, std::size_t(24) << 30};
  EXPECT_EQ(advice_on_blocks(config, {1e8, 0, 1.0, 100'000}, device).blocks, 1u);
  EXPECT_GT(advice_on_blocks(config, {1e8, 0, 1.0, 40'000'000}, device).blocks, 1u);
}

TEST(Forecast, AddsUpWhatTheGpuHolds) {
  Config config = adaptive_config();
  config.density.strategy = "mcmc";
  config.density.max_gaussians = 10'000'000;
  SceneSize scene = {1e9, 0, 2.0, 30'000};
  const ForecastDevice device = {true, std::size_t(80) << 30};
  EXPECT_THAT(forecast(config, scene, device).text, HasSubstr("takes about 6.2 GiB of GPU memory"));
  config.train.deterministic = true;  // 208 bytes more, and a reserve
  EXPECT_THAT(forecast(config, scene, device).text, HasSubstr("takes about 8.1 GiB of GPU memory"));
  config.train.deterministic = false;
  scene.train_share = 0.5;
  EXPECT_THAT(forecast(config, scene, device).text, HasSubstr("takes about 5.7 GiB of GPU memory"));
}

// The first scene of a phone: 18 million pixels take 5.5 GiB on the CPU, whatever the Gaussians.
TEST(Forecast, CountsThePicturesOfARunOnTheCpu) {
  Config config = adaptive_config();
  config.train.iterations = 200;
  SceneSize scene = {0, 0, 1.0, 1000};
  EXPECT_THAT(forecast(config, scene, {}).text, HasSubstr("takes about 0.3 GiB of RAM"));
  scene.largest_megapixels = 18.4;
  EXPECT_THAT(forecast(config, scene, {}).text, HasSubstr("takes about 5.5 GiB of RAM"));
}

TEST(Forecast, CountsPhotosThatAreNotLoadedYet) {
  Config config = adaptive_config();
  config.dataset.photo_ram_gib = 1e6f;
  SceneSize scene = {1e15, 0, 1.0, 30000};
  EXPECT_THAT(forecast(config, scene, {true, 0}).warnings, ElementsAre(HasSubstr("--photo-ram")));
  scene.loaded_bytes = scene.photo_bytes;
  EXPECT_THAT(forecast(config, scene, {true, 0}).warnings, IsEmpty());
}

}  // namespace
}  // namespace gs
