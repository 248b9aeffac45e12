// SPDX-License-Identifier: Apache-2.0
#include "gs_train/loop/view_sampler.h"

#include "tests/support/test.h"

namespace gs {
namespace {

constexpr std::size_t kViews = 30;

/// The views of an epoch 0, 1, ... in their order.
std::vector<std::size_t> epoch_of(ViewSampler& sampler, int epoch, std::size_t views = kViews) {
  std::vector<std::size_t> order(views);
  for (std::size_t i = 0; i < views; ++i) order[i] = sampler.view_of(int(epoch * views + i) + 1);
  return order;
}

TEST(ViewSampler, ShowsEveryViewOnceInEachEpoch) {
  for (const std::size_t views : {std::size_t(1), std::size_t(2), kViews}) {
    ViewSampler sampler(views, 1);
    std::vector<std::size_t> all(views);
    std::iota(all.begin(), all.end(), std::size_t(0));
    for (int epoch = 0; epoch < 20; ++epoch) {
      std::vector<std::size_t> order = epoch_of(sampler, epoch, views);
      std::sort(order.begin(), order.end());
      EXPECT_EQ(order, all);
    }
  }
}

TEST(ViewSampler, ShufflesEachEpochAnew) {
  ViewSampler sampler(kViews, 1);
  EXPECT_NE(epoch_of(sampler, 0), epoch_of(sampler, 1));
  EXPECT_NE(epoch_of(sampler, 1), epoch_of(sampler, 2));
}

TEST(ViewSampler, DependsOnTheSeed) {
  ViewSampler a(kViews, 1), b(kViews, 2), again(kViews, 1);
  EXPECT_NE(epoch_of(a, 0), epoch_of(b, 0));
  EXPECT_EQ(epoch_of(a, 0), epoch_of(again, 0));
}

TEST(ViewSampler, AnswersForAStepWhateverWasAskedBefore) {
  ViewSampler in_order(kViews, 3), jumping(kViews, 3);
  std::vector<std::size_t> views;
  for (int step = 1; step <= 200; ++step) views.push_back(in_order.view_of(step));
  for (const int step : {150, 151, 1, 200, 31, 30, 150})
    EXPECT_EQ(jumping.view_of(step), views[step - 1]) << step;
}

// Each of 4 views comes first in a quarter of the epochs: 1000 +- 27.
TEST(ViewSampler, StartsWithEachViewEquallyOften) {
  ViewSampler sampler(4, 4);
  int first[4] = {};
  for (int epoch = 0; epoch < 4000; ++epoch) ++first[sampler.view_of(4 * epoch + 1)];
  for (const int count : first) EXPECT_NEAR(count, 1000, 140);
}

}  // namespace
}  // namespace gs
