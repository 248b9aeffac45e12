// SPDX-License-Identifier: Apache-2.0
#include "gs_render/frame_forecast.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

constexpr FrameKind kKind{1200, 900, 1'000'000};

FrameForecast after(std::initializer_list<std::uint32_t> counts) {
  FrameForecast forecast;
  for (const std::uint32_t count : counts) forecast.note(kKind, count);
  return forecast;
}

TEST(FrameForecast, TheFirstTwoFramesAreCounted) {
  EXPECT_EQ(after({}).capacity_for(kKind), 0u);
  EXPECT_EQ(after({1'000'000}).capacity_for(kKind), 0u);
  EXPECT_GT(after({1'000'000, 1'000'000}).capacity_for(kKind), 1'000'000u);
}

TEST(FrameForecast, ARepeatedFrameNeedsLittleMoreThanItHas) {
  EXPECT_EQ(after({6'400'000, 6'400'000}).capacity_for(kKind), 6'500'000u);
}

TEST(FrameForecast, TheNextFrameMayChangeTwiceAsMuch) {
  EXPECT_EQ(after({1'000'000, 1'050'000}).capacity_for(kKind), 1'150'000u);
  EXPECT_EQ(after({1'050'000, 1'000'000}).capacity_for(kKind), 1'100'000u);
}

TEST(FrameForecast, AfterAJumpFramesAreCountedUntilTheyAreSteadyAgain) {
  EXPECT_EQ(after({1'000'000, 1'000'000, 2'000'000}).capacity_for(kKind), 0u);
  EXPECT_EQ(after({2'000'000, 2'000'000, 1'000'000}).capacity_for(kKind), 0u);
  EXPECT_GT(after({1'000'000, 2'000'000, 2'000'000}).capacity_for(kKind), 2'000'000u);
}

TEST(FrameForecast, AFewInstancesAreNoJump) {
  EXPECT_EQ(after({0, 4000}).capacity_for(kKind), 12'000u);
  EXPECT_EQ(after({4000, 0}).capacity_for(kKind), 8'000u);
  EXPECT_EQ(after({0, 0}).capacity_for(kKind), 4096u);
}

TEST(FrameForecast, CapacitiesAreNoMoreThanCanBeSorted) {
  const std::uint32_t most = 0x7fffffff;
  EXPECT_EQ(after({most, most}).capacity_for(kKind), most);
}

TEST(FrameForecast, KindsAreIndependentAndOldOnesAreForgotten) {
  FrameForecast forecast = after({1'000'000, 1'000'000});
  FrameKind other = kKind;
  other.gaussians = 5;
  EXPECT_EQ(forecast.capacity_for(other), 0u);
  for (int width = 1; width <= 7; ++width) forecast.note({width, 1, 1}, 7);
  EXPECT_GT(forecast.capacity_for(kKind), 0u);
  forecast.note({8, 1, 1}, 7);
  EXPECT_EQ(forecast.capacity_for(kKind), 0u);
}

}  // namespace
}  // namespace gs
