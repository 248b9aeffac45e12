// SPDX-License-Identifier: Apache-2.0
// What each published method does in one refinement, and what it counts: on a hand-made model, with
// the constants that its file in gs_core/density names.
#include "gs_train/density/density_control.h"
#include "tests/support/adaptive.h"
#include "tests/support/models.h"
#include "tests/support/scoring_backend.h"

namespace gs {
namespace {

constexpr float kExtent = 1;
constexpr std::size_t kRows = 40;

/// Forty Gaussians in a row, every second one of them large, which a photo saw: all want to grow.
/// Row i has the score i + 1 under every score but "gradient", whose is 1 for all.
class Method : public ::testing::Test {
 protected:
  Method() {
    Gaussians gaussians(kRows, host_memory());
    for (std::size_t i = 0; i < kRows; ++i)
      set_gaussian(gaussians, i, {float(i), 0, 0}, i % 2 ? 0.05f : 0.005f, 0.5f);
    model_ = model_of(gaussians);
    begin_sums(model_);
    for (std::size_t i = 0; i < kRows; ++i) {
      model_.statistics.visits[i] = 1;
      model_.statistics.gradient_norm[i] = 1;
      const float score = float(i + 1);
      // With one fragment the force is (2 Q - F^2) / 4.
      backend_.sums.push_back({1, score, (4 * score + score * score) / 2});
    }
    model_.statistics.sums.upload(backend_.sums);
    config_ = adaptive_config();
    config_.density.max_gaussians = 1000;
  }

  /// One refinement, or whatever else the method does after that step of 30,000.
  RefineReport after(const std::string& strategy, int step, std::size_t views = 0) {
    config_.density.strategy = strategy;
    const Schedule schedule(config_, kExtent, views);
    const auto control = make_density_control(config_, schedule, kExtent);
    control->set_photos({views_.size(), [this](std::size_t photo, int) {
                           return TrainingPhoto{&views_[photo], {}, 1, photo};
                         }});
    return control->after_step(model_, backend_, step);
  }
  float opacity(std::size_t i) const { return sigmoid(model_.gaussians.logit_opacity[i]); }

  Config config_;
  TrainingModel model_;
  const std::vector<View> views_ = std::vector<View>(30);
  ScoringBackend backend_;  // score passes give these sums
};

TEST_F(Method, AdaptiveClonesSmallOnesAndSplitsLargeOnesAsTheyAre) {
  const RefineReport report = after("adaptive", 700);
  EXPECT_EQ(report.cloned, kRows / 2);
  EXPECT_EQ(report.split, kRows / 2);
  EXPECT_EQ(model_.count(), 2 * kRows);
  for (std::size_t i = 0; i < model_.count(); ++i) EXPECT_NEAR(opacity(i), 0.5f, 1e-6f);
}

TEST_F(Method, AdaptiveResetsOpacitiesToAHundredth) {
  after("adaptive", 3000);
  EXPECT_NEAR(opacity(0), 0.01f, 1e-6f);
}

TEST_F(Method, AbsGsIsAdaptiveWithAbsoluteGradients) {
  GrowthMethod expected = adaptive_method();
  expected.absolute_gradient = true;
  EXPECT_EQ(absgs_method(), expected);
  EXPECT_EQ(after("absgs", 700).cloned, kRows / 2);
}

// The curve allows all at the last refinement, and each row may grow in it.
TEST_F(Method, GrowthAddsWhatTheCurveAllowsAndSplitsAlongTheLongestAxis) {
  const RefineReport report = after("growth", 14900);
  EXPECT_EQ(report.cloned + report.split, kRows);
  EXPECT_GT(report.split, 0u);
  EXPECT_NEAR(opacity(model_.count() - 1), 0.7f * 0.5f, 1e-6f);  // of a child
}

TEST_F(Method, GrowthHalvesOpacities) {
  config_.density.until_step = 0;
  after("growth", 3000);
  EXPECT_NEAR(opacity(0), 0.25f, 1e-6f);
}

// A fifth of the count in one refinement; of equal gradients the first rows grow.
TEST_F(Method, DashGaussianAddsAFifthOfThemByGradient) {
  EXPECT_EQ(after("dash_gaussian", 14900).cloned, std::size_t(0.2f * kRows / 2));
  EXPECT_EQ(model_.count(), kRows + std::size_t(0.2f * kRows));
}

// N_0 + (B - N_0) / 4^2 before there is growth, with pictures a quarter as large.
TEST_F(Method, DashGaussianBeginsWithASixteenthOfTheRise) {
  config_.density.max_gaussians = kRows + 64;
  after("dash_gaussian", 600);
  EXPECT_EQ(model_.count(), kRows + 4);
}

// Six pixels of a photo in the mask, in the mean over the ten photos of the score pass.
TEST_F(Method, FastGsGrowsWhereSixPixelsShowAnErrorAndCapsOpacities) {
  for (std::size_t i = 0; i < kRows; ++i) {
    backend_.sums[i].second = i < 10 ? 60.0f : 59.0f;
    model_.gaussians.logit_opacity[i] = logit(0.95f);
  }
  const RefineReport report = after("fastgs", 700);
  EXPECT_EQ(report.cloned + report.split, 10u);
  EXPECT_EQ(backend_.photos.size(), 10u);
  EXPECT_EQ(backend_.rule, (PixelRule{GrowthScore::mask, 0.1f}));
  EXPECT_EQ(report.cloned, 0u);  // 0.005 is large: cloned are those below 0.001 of the extent
  for (std::size_t i = 0; i < model_.count(); ++i) EXPECT_NEAR(opacity(i), 0.8f, 1e-5f);
}

TEST_F(Method, FastGsRemovesTheFaintLate) {
  for (std::size_t i = 0; i < 7; ++i) model_.gaussians.logit_opacity[i] = logit(0.09f);
  EXPECT_EQ(after("fastgs", 15000).pruned, 0u);
  EXPECT_EQ(after("fastgs", 18000).pruned, 7u);
}

TEST_F(Method, ImprovedGsSplitsAllThatGrow) {
  config_.density.max_gaussians = kRows + 12;
  const RefineReport report = after("improved_gs", 14900);
  EXPECT_EQ(report.cloned, 0u);
  EXPECT_EQ(report.split, 12u);
  EXPECT_EQ(backend_.photos.size(), 10u);
  EXPECT_EQ(backend_.rule.score, GrowthScore::edge);
  EXPECT_EQ(model_.count(), kRows + 12);
  EXPECT_NEAR(opacity(model_.count() - 1), 0.6f * 0.5f, 1e-6f);
}

TEST_F(Method, ImprovedGsResetsToATwentiethAndRemovesAFifthAfterwards) {
  after("improved_gs", 3000);
  EXPECT_NEAR(opacity(0), 0.05f, 1e-6f);
  const std::size_t before = model_.count();
  EXPECT_EQ(after("improved_gs", 3300).pruned, before / 5);
  EXPECT_EQ(after("improved_gs", 9300).pruned, 0u);  // after two resets no more
}

// Each photo of the epoch showed all but the first ten.
TEST_F(Method, LiteGsKeepsParentsAndRemovesWhatNoPhotoShowed) {
  for (std::size_t i = 0; i < 10; ++i) model_.statistics.sums[i] = {};
  config_.density.max_gaussians = 33;
  const RefineReport report = after("litegs", 14900, 50);
  EXPECT_EQ(report.pruned, 10u);
  EXPECT_EQ(report.cloned + report.split, 3u);
  ASSERT_EQ(model_.count(), 33u);
  for (std::size_t i = 0; i < 30; ++i) EXPECT_EQ(model_.gaussians.mean[i].x, float(i + 10));
}

TEST_F(Method, McmcMovesTheDeadAndAddsAShare) {
  for (std::size_t i = 0; i < 5; ++i) model_.gaussians.logit_opacity[i] = logit(0.001f);
  const RefineReport report = after("mcmc", 700);
  EXPECT_EQ(report.moved, 5u);
  EXPECT_EQ(model_.count(), kRows + kRows / 20);
}

TEST_F(Method, SpeedySplatRemovesFourFifthsWhileThereIsGrowthAndAThirdAfterwards) {
  EXPECT_EQ(after("speedy_splat", 6000, 100).pruned, kRows * 4 / 5);
  ASSERT_EQ(model_.count(), kRows / 5);
  for (std::size_t i = 0; i < model_.count(); ++i)  // the squares of forces rise with the row
    EXPECT_EQ(model_.gaussians.mean[i].x, float(kRows - kRows / 5 + i));
  EXPECT_EQ(after("speedy_splat", 15000, 100).pruned, 2u);  // 0.3 of 8
}

TEST_F(Method, TamingFollowsItsParabola) {
  config_.density.max_gaussians = kRows + 16;
  config_.density.until_step = 15000;  // at step 7,800 half of the window is over
  after("taming", 7800);
  EXPECT_EQ(model_.count(), kRows + 12);  // 2 u - u^2 = 3/4
  EXPECT_EQ(backend_.photos.size(), 10u);
  EXPECT_EQ(backend_.rule.score, GrowthScore::error);
}

}  // namespace
}  // namespace gs
