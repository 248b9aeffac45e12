// SPDX-License-Identifier: Apache-2.0
#include "gs_train/density/gaussian_budget.h"

#include <gtest/gtest.h>

#include "gs_render/render_pass.h"

namespace gs {
namespace {

constexpr std::size_t kGib = std::size_t(1) << 30;

TEST(GaussiansFor, IsTheFormula) {
  EXPECT_EQ(gaussians_for({10 * kGib, 1'000'000, 100'000}),
            std::int64_t((0.85 * double(10 * kGib) - 256e6 + 708e5) / 2048));
}

TEST(GaussiansFor, IsNeverLessThanThereAreNorMoreThanCanBeNumbered) {
  EXPECT_EQ(gaussians_for({0, 1'000'000, 100'000}), 100'000);
  EXPECT_EQ(gaussians_for({0, 1'000'000, 0}), 1);
  EXPECT_EQ(gaussians_for({100'000 * kGib, 0, 0}), std::int64_t(kMostGaussians) - 1);
}

TEST(GaussiansFor, CountsTheNumbersOfTimeAndTheSumsOfBatches) {
  const GaussianBudget budget{10 * kGib, 0, 0};
  GaussianBudget in_time = budget, in_batches = budget;
  in_time.has_time = true;
  in_batches.batch = 4;
  const double usable = 0.85 * double(10 * kGib);
  EXPECT_EQ(gaussians_for(in_time), std::int64_t(usable / (2048 + 6 * 24)));
  EXPECT_EQ(gaussians_for(in_batches), std::int64_t(usable / (2048 + 236 + 8)));
}

// 354 bytes of moments less, and half of that again, since arrays grow by halves.
TEST(GaussiansFor, CountsTheBytesOfHalfMoments) {
  GaussianBudget budget{10 * kGib, 0, 100'000};
  budget.moments = MomentStorage::halves;
  const double free = 0.85 * double(10 * kGib);
  EXPECT_EQ(gaussians_for(budget), std::int64_t((free + 354e5) / (2048 - 531)));
  budget.has_time = true;
  EXPECT_EQ(gaussians_for(budget), std::int64_t((free + 390e5) / (2048 + 6 * 24 - 585)));
}

TEST(GaussiansOnGpu, TakeNineTenthsOfWhatIsFreeAndOfTheirOwn) {
  TrainingSize size;
  size.pixels = 1e6;
  for (const std::size_t present : {std::size_t(0), std::size_t(1'000'000)}) {
    const std::int64_t count = gaussians_on_gpu(size, 10 * kGib, present);
    size.gaussians = double(count);
    EXPECT_NEAR(training_bytes(size), 0.9 * double(10 * kGib) + 716.0 * double(present), 1e6);
  }
}

TEST(GaussiansOnGpu, AreNeverLessThanThereAreNorMoreThanCanBeNumbered) {
  EXPECT_EQ(gaussians_on_gpu({}, 0, 100'000), 100'000);
  EXPECT_EQ(gaussians_on_gpu({}, 0, 0), 1);
  EXPECT_EQ(gaussians_on_gpu({}, 100'000 * kGib, 0), std::int64_t(kMostGaussians) - 1);
}

TEST(HostMemory, SaysHowMuchIsFree) {
  EXPECT_GT(host_memory().free_bytes(), std::size_t(1) << 20);
  EXPECT_LT(host_memory().free_bytes(), std::size_t(1) << 50);
}

}  // namespace
}  // namespace gs
