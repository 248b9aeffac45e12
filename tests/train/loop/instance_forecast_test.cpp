// SPDX-License-Identifier: Apache-2.0
// How many places training on a GPU takes for the instances of a view. No GPU is needed.
#include "cuda/step/instance_forecast.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

using cuda::InstanceForecast;
constexpr double kTwoSteps = 2.0 * double(cuda::kCapacityStep);  // capacities are rounded up

TEST(InstanceForecast, AFirstViewHasFewPlacesForEachOfManyGaussians) {
  const View view{};
  const TrainingPhoto photo{&view, {}};
  const InstanceForecast forecast;
  EXPECT_NEAR(forecast.capacity_for(photo, 1000), kLeastCapacity, kTwoSteps);
  EXPECT_NEAR(forecast.capacity_for(photo, 10'000'000), 13e6, kTwoSteps);
}

TEST(InstanceForecast, AKnownViewHasAFifthMoreThanAtItsLastVisit) {
  const View view{};
  const TrainingPhoto photo{&view, {}};
  InstanceForecast forecast;
  forecast.note(photo, 5'000'000, 1'000'000);
  EXPECT_NEAR(forecast.capacity_for(photo, 1'000'000), 6e6, kTwoSteps);
  EXPECT_NEAR(forecast.capacity_for(photo, 2'000'000), 12e6, kTwoSteps);
}

TEST(InstanceForecast, AViewThatIsNewHasTheMarginOfItsCount) {
  const View seen{}, unseen{};
  const TrainingPhoto first{&seen, {}}, second{&unseen, {}};
  InstanceForecast few, many;
  few.note(first, 2'000'000, 500'000);
  EXPECT_NEAR(few.capacity_for(second, 500'000), 1.5 * 2e6, kTwoSteps);
  many.note(first, 18'000'000, 10'000'000);
  EXPECT_NEAR(many.capacity_for(second, 10'000'000), 1.25 * 18e6, kTwoSteps);
}

}  // namespace
}  // namespace gs
