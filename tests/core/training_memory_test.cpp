// SPDX-License-Identifier: Apache-2.0
#include "gs_core/forecast/training_memory.h"

#include <gtest/gtest.h>

#include "gs_core/forecast/gpu_step.h"
#include "gs_core/model_rows.h"

namespace gs {
namespace {

/// A run whose Gaussians stay as many as they are, so that nothing is held in reserve.
TrainingSize steady(double gaussians) {
  TrainingSize size;
  size.gaussians = gaussians;
  size.growth = RowGrowth::none;
  return size;
}

/// What one more Gaussian takes where there are many.
double bytes_of_gaussian(TrainingSize size) {
  size.gaussians = 10e6;
  const double fewer = training_bytes(size);
  size.gaussians = 11e6;
  return (training_bytes(size) - fewer) / 1e6;
}

/// The bytes of a row of all arrays that a TrainingModel has.
double row_bytes(const ModelRows& model) {
  double bytes = 0;
  for (const auto& column : model.columns()) bytes += double(column.rows->row_bytes());
  return bytes;
}

TEST(TrainingMemory, TheStateIsThatOfTheModelsArrays) {
  for (int form = 0; form < 16; ++form) {
    SCOPED_TRACE(form);
    TrainingSize size;
    ModelRows model;
    size.has_time = model.gaussians.has_time = form & 1;
    size.has_filter = model.gaussians.has_filter = form & 2;
    size.has_sums = model.statistics.has_sums = form & 4;
    model.store_moments_as(size.moments = MomentStorage(form / 8));
    model.match_moments();
    EXPECT_DOUBLE_EQ(state_bytes(size, 1000), 1000 * row_bytes(model));
  }
  EXPECT_DOUBLE_EQ(state_bytes({}, 1), 716);  // 59 * 4 * 3 + 8
  EXPECT_DOUBLE_EQ(state_bytes({.moments = MomentStorage::halves}, 1), 362);
}

TEST(TrainingMemory, AGaussianTakesTheSumOfItsArrays) {
  // splat, rectangle, gradient and five words, and the places for instances
  const double step = sizeof(Splat) + sizeof(Rect) + sizeof(SplatGradientSum) + 5 * 4;
  const double instances = kInstancePlaces * (8 + 4);
  const TrainingSize plain = steady(0);
  EXPECT_NEAR(bytes_of_gaussian(plain), 716 + step + instances, 0.01);

  const auto more = [&](auto&& change) {
    TrainingSize size = plain;
    change(size);
    return bytes_of_gaussian(size) - bytes_of_gaussian(plain);
  };
  EXPECT_NEAR(more([](TrainingSize& size) { size.is_deterministic = true; }), 208, 0.01);
  EXPECT_NEAR(more([](TrainingSize& size) { size.has_sums = true; }), 12, 0.01);
  EXPECT_NEAR(more([](TrainingSize& size) { size.has_sums = size.is_absolute = true; }), 12 + 16,
              0.01);
  EXPECT_NEAR(more([](TrainingSize& size) { size.has_time = true; }), 3 * 24, 0.01);
  EXPECT_NEAR(more([](TrainingSize& size) { size.has_filter = true; }), 4, 0.01);
  // checkpoints of depths: 4 bytes of each pixel of a tile for 512 places
  EXPECT_NEAR(more([](TrainingSize& size) { size.has_depth_maps = true; }), kInstancePlaces * 2,
              0.01);
  EXPECT_NEAR(more([](TrainingSize& size) { size.batch = 2; }), 112, 0.01);
  EXPECT_NEAR(more([](TrainingSize& size) { size.batch = 4; }), 3 * 112, 0.01);
  EXPECT_NEAR(more([](TrainingSize& size) { size.batch = 8; }), 7 * 112, 0.01);
  EXPECT_NEAR(more([](TrainingSize& size) { size.instance_places += 1; }), 12, 0.01);
  // where a Gaussian is on a ray, and keys of 32 bits
  EXPECT_NEAR(more([](TrainingSize& size) { size.is_by_pixel = true; }), 24 + kInstancePlaces * 4,
              0.01);
}

// Each photo but one also keeps what stages 5 and 6 add for other photos once alone.
TEST(TrainingMemory, PhotosOfABatchKeepSumsOfTheirOwn) {
  const auto bytes_of_photo = [](auto&& change) {
    TrainingSize size = steady(0);
    change(size);
    size.batch = 3;
    const double of_three = bytes_of_gaussian(size);
    size.batch = 2;
    return of_three - bytes_of_gaussian(size);
  };
  EXPECT_NEAR(bytes_of_photo([](TrainingSize& size) { size.has_time = true; }), 112, 0.01);
  EXPECT_NEAR(bytes_of_photo([](TrainingSize& size) { size.has_sums = true; }), 112, 0.01);
  EXPECT_NEAR(
      bytes_of_photo([](TrainingSize& size) { size.has_sums = size.is_deterministic = true; }),
      112 + 24, 0.01);
  EXPECT_NEAR(bytes_of_photo([](TrainingSize& size) { size.has_sums = size.is_absolute = true; }),
              112 + 16, 0.01);
  EXPECT_NEAR(bytes_of_photo([](TrainingSize& size) { size.has_depth_maps = true; }), 112, 0.01);
}

TEST(TrainingMemory, PhotosWithDepthMapsKeepTheirForcesApart) {
  TrainingSize size = steady(0);
  size.batch = 2;
  size.has_depth_maps = true;
  const double without = bytes_of_gaussian(size);
  size.has_sums = true;
  EXPECT_NEAR(bytes_of_gaussian(size) - without, 12 + 2 * 16, 0.01);
}

TEST(TrainingMemory, TakesTheBytesOfMomentsFromTheConfig) {
  Config config;
  EXPECT_EQ(training_size(config, {}, 1).moments, MomentStorage::halves);
  config.optimizer.moments = MomentStorage::floats;
  EXPECT_EQ(training_size(config, {}, 1).moments, MomentStorage::floats);
}

TEST(TrainingMemory, ARunHasItsFirstGaussiansForCertainAndACapThatItRisesTo) {
  Config config;
  config.density.max_gaussians = 5000;
  EXPECT_EQ(certain_gaussians(config, 100), 5000);
  EXPECT_EQ(certain_gaussians(config, 6000), 6000);
  config.density.strategy = "adaptive";  // the cap is a limit only
  EXPECT_EQ(certain_gaussians(config, 100), 100);
}

TEST(TrainingMemory, TenMillionGaussiansStayBelowEightAndAHalfGib) {
  TrainingSize size = steady(10e6);
  size.pixels = 1600 * 1064;
  size.photo_bytes = 8 * 3 * size.pixels;
  size.instance_places = 1.78 * 1.3;
  EXPECT_LT(training_bytes(size), 8704.0 * (1 << 20));
  EXPECT_GT(training_bytes(size), 8000.0 * (1 << 20));
}

TEST(TrainingMemory, GrowingArraysHaveAReserve) {
  TrainingSize size = steady(1e6);
  const double none = training_bytes(size);
  size.growth = RowGrowth::reserved;
  const double reserved = training_bytes(size);
  size.growth = RowGrowth::by_need;
  const double by_need = training_bytes(size);
  EXPECT_GT(reserved, 1.01 * none);
  // Of the old moments of SH, which are there for a while, a part is in place of the step.
  EXPECT_GT(by_need, reserved + 1e6 * (0.015 * 716 + 220));
  size.moments = MomentStorage::halves;  // the old coefficients are more than their moments
  const double of_halves = training_bytes(size);
  size.growth = RowGrowth::reserved;
  EXPECT_GT(of_halves, training_bytes(size) + 1e6 * (0.015 * 362 + 40));
  EXPECT_LT(of_halves, training_bytes(size) + 1e6 * 120);
}

TEST(TrainingMemory, PhotosBeyondTheBudgetHaveFourPlaces) {
  Config config;
  config.train.photo_gib = 1;
  PictureSizes pictures{1e6, 5e8, 4e6, 0};
  EXPECT_EQ(training_size(config, pictures, 1).photo_bytes, 5e8);
  pictures.photo_bytes = 2e9;
  EXPECT_EQ(training_size(config, pictures, 1).photo_bytes, double(1 << 30) + 4 * 4e6);
}

TEST(TrainingMemory, DepthMapsCountWhereTheyTeach) {
  Config config;
  const PictureSizes pictures{1e6, 0, 0, 5e6};
  config.loss.depth_weight = 0;
  const double without = training_bytes(training_size(config, pictures, 1000));
  config.loss.depth_weight = 0.1f;
  const double with = training_bytes(training_size(config, pictures, 1000));
  const double checkpoints = 2 * (1 << 20);  // of the least room for instances
  EXPECT_NEAR(with - without, 4 * 5e6 + 12 * 1e6 + checkpoints, 1e5);
}

TEST(TrainingMemory, NormalMapsCountWhereTheyTeach) {
  Config config;
  const PictureSizes pictures{1e6, 0, 0, 0, 5e6};
  config.surface.normal_weight = 0.1f;
  const double without = training_bytes(training_size(config, pictures, 1000));
  config.surface.prior_weight = 0.1f;
  EXPECT_NEAR(training_bytes(training_size(config, pictures, 1000)) - without, 3 * 5e6, 1);
}

TEST(TrainingMemory, SettingsDecideWhichArraysThereAre) {
  Config config;
  config.density.max_gaussians = 1000;
  EXPECT_EQ(training_size(config, {}, 1).growth, RowGrowth::reserved);
  EXPECT_TRUE(training_size(config, {}, 1).has_sums);  // the score "force"
  config.density.strategy = "adaptive";
  EXPECT_EQ(training_size(config, {}, 1).growth, RowGrowth::by_need);
  EXPECT_FALSE(training_size(config, {}, 1).has_sums);
  config.density.strategy = "mcmc";
  EXPECT_EQ(training_size(config, {}, 1).growth, RowGrowth::reserved);
  EXPECT_TRUE(training_size(config, {}, 1).relocates);
  config.density.strategy = "taming";
  EXPECT_TRUE(training_size(config, {}, 1).has_score_pass);
  config.density.strategy = "speedy_splat";  // measures sensitivities by the same sums
  EXPECT_TRUE(training_size(config, {}, 1).has_sums);
  config.density.strategy = "absgs";
  EXPECT_TRUE(training_size(config, {}, 1).is_absolute);
}

TEST(TrainingMemory, FittingGaussiansTakeTheBytes) {
  TrainingSize size;
  size.pixels = 1e6;
  for (const double bytes : {1e9, 10e9, 100e9}) {
    size.gaussians = gaussians_that_fit(size, bytes);
    EXPECT_NEAR(training_bytes(size), bytes, 1e-3 * bytes);
  }
  EXPECT_LT(gaussians_that_fit(size, 1000), 1);
}

TEST(Buffers, TakeAHalfInReserveWhileTheyAreSmallAndLessLater) {
  constexpr std::size_t kMiB = 1 << 20;
  EXPECT_EQ(grown_bytes(1000, 1001), 1500u);
  EXPECT_EQ(grown_bytes(1000, 5000), 5000u);
  EXPECT_EQ(grown_bytes(kMiB, kMiB + 1), kMiB / 16 * 17);
  EXPECT_EQ(grown_bytes(160 * kMiB, 160 * kMiB + 1), 165 * kMiB);
}

}  // namespace
}  // namespace gs
