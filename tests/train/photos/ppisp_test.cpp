// SPDX-License-Identifier: Apache-2.0
// The photometric model "ppisp": one photo's appearance, and runs on photos multiplied by known
// gains. What all models share is tested with gains, in photometric_test.cpp.
#include <gtest/gtest.h>

#include <cmath>

#include "gs_train/metrics.h"
#include "gs_train/photometric/ppisp.h"
#include "tests/support/scene_run.h"
#include "tests/support/wall_scene.h"

namespace gs {
namespace {

const PhotometricConfig kPpisp{kPpispModel, 2e-3f, true};
constexpr std::size_t kPhotoNumbers = 9, kNumbers = 12;

/// A picture and weights of its pixels, whose weighted sum stands for a loss.
class PpispOfAPhoto : public ::testing::Test {
 protected:
  static constexpr int kWidth = 16, kHeight = 12;
  static constexpr std::size_t kPixels = kWidth * kHeight;

  PpispOfAPhoto() : picture_(3 * kPixels), weights_(3 * kPixels) {
    Draws draws(4);
    for (float& value : picture_) value = draws.uniform(0.05f, 0.9f);
    for (float& value : weights_) value = draws.uniform(-1, 1);
    for (float& value : numbers_) value = draws.uniform(-0.8f, 0.8f);
  }

  std::unique_ptr<Appearance> appearance() const {
    return make_photometric_model(kPpisp)->appearance(
        {numbers_.data(), kPhotoNumbers},
        {numbers_.data() + kPhotoNumbers, kNumbers - kPhotoNumbers},
        lens_place(7, 6, kWidth, kHeight, 1));
  }
  double weighted_sum() const {
    const auto shown = appearance();
    shown->show({picture_.data(), kWidth, kHeight});
    double sum = 0;
    for (std::size_t i = 0; i < picture_.size(); ++i)
      sum += double(weights_[i]) * double(shown->shown()[i]);
    return sum;
  }
  double finite_difference(float& number) {
    constexpr float kStep = 2e-3f;
    const float before = number;
    number = before + kStep;
    const double more = weighted_sum();
    number = before - kStep;
    const double less = weighted_sum();
    number = before;
    return (more - less) / (2 * double(kStep));
  }

  std::vector<float> picture_, weights_, numbers_ = std::vector<float>(kNumbers);
};

TEST_F(PpispOfAPhoto, HasTheGradientOfFiniteDifferences) {
  const auto shown = appearance();
  std::vector<float> gradient = weights_;
  shown->pull_back({picture_.data(), kWidth, kHeight}, {gradient.data(), gradient.size()}, {});
  for (std::size_t i = 0; i < kNumbers; ++i) {
    const double expected = finite_difference(numbers_[i]);
    EXPECT_NEAR(shown->gradient()[i], expected, 0.005 * std::abs(expected) + 1e-3) << i;
  }
  for (const std::size_t i : {0u, 50u, 250u, 500u}) {
    const double expected = finite_difference(picture_[i]);
    EXPECT_NEAR(gradient[i], expected, 0.005 * std::abs(expected) + 1e-3) << i;
  }
}

TEST_F(PpispOfAPhoto, LearnsNothingFromPixelsWithoutAShare) {
  const auto shown = appearance();
  std::vector<float> gradient = weights_;
  const std::vector<float> shares(kPixels, 0.0f);
  shown->pull_back({picture_.data(), kWidth, kHeight}, {gradient.data(), gradient.size()},
                   {shares.data(), shares.size()});
  for (std::size_t i = 0; i < kNumbers; ++i) EXPECT_EQ(shown->gradient()[i], 0) << i;
  EXPECT_NE(gradient[0], 0);
}

TEST_F(PpispOfAPhoto, ShowsTheSceneItselfWhereAllNumbersAreZero) {
  numbers_.assign(kNumbers, 0.0f);
  const auto shown = appearance();
  shown->show({picture_.data(), kWidth, kHeight});
  for (std::size_t i = 0; i < picture_.size(); ++i)
    EXPECT_NEAR(shown->shown()[i], picture_[i], 1e-6f) << i;
}

TEST_F(PpispOfAPhoto, BeginsWithTheGainsOfGray) {
  const Vec3f gains{0.8f, 1.0f, 1.3f};
  numbers_.assign(kNumbers, 0.0f);
  make_photometric_model(kPpisp)->start_from_gains(gains, {numbers_.data(), kPhotoNumbers});
  picture_.assign(3 * kPixels, 0.4f);
  const auto shown = appearance();
  shown->show({picture_.data(), kWidth, kHeight});
  for (std::size_t c = 0; c < 3; ++c)
    EXPECT_NEAR(shown->shown()[c * kPixels], 0.4f * gains[int(c)], 1e-5f) << c;
}

class PpispRun : public SceneRun {
 protected:
  PpispRun() : SceneRun(wall_scene(true)) {}

  static Config run_of(const std::string& model, int steps) {
    Config config = gains_run(steps);
    config.photometric.model = model;
    return config;
  }
  double neutral_psnr(const TrainingModel& model) {
    return evaluate(backend_->renderer(), model.gaussians.span(), wall_scene(false).train_views, {})
        .psnr;
  }
};

TEST_F(PpispRun, LeavesTheSceneItsOwnColors) {
  EXPECT_GT(neutral_psnr(trained(run_of(kPpispModel, 1500))),
            neutral_psnr(trained(run_of("none", 1500))) + 3);
}

// The mean of all photos is the scene's, for exposures in the middle of the photo and for colors.
TEST_F(PpispRun, KeepsAMeanOfZero) {
  const TrainingModel model = trained(run_of(kPpispModel, 50));
  const PhotometricState& state = model.photometric;
  EXPECT_EQ(state.shape, (PhotometricShape{kWallViews, kPhotoNumbers, kWallCameras, 3}));
  for (const double number : make_photometric_model(kPpisp)->common_part(state))
    EXPECT_NEAR(number, 0, 1e-5);
  EXPECT_NE(state.photo(0)[0], 0);
  EXPECT_NE(state.photo(0)[8], 0);
}

TEST_F(PpispRun, GoesOnWhereItWasStopped) {
  expect_goes_on_after({1, 29}, run_of(kPpispModel, 40));
}

}  // namespace
}  // namespace gs
