// SPDX-License-Identifier: Apache-2.0
// Stage 8 under the MCMC strategy: regularizers in the gradient, and noise on the means.
#include "gs_train/stages/scalar_stages.h"
#include "tests/support/models.h"

namespace gs {
namespace {

constexpr float kRate = 1e-3f;

Gaussians some_gaussians(std::size_t count, float opacity) {
  Gaussians gaussians(count, host_memory());
  for (std::size_t i = 0; i < count; ++i)
    set_gaussian(gaussians, i, {float(i), 0, 0}, 0.5f, opacity);
  return gaussians;
}
PositionNoise noise_of(std::uint64_t seed, int step) {
  return {2.0f, {seed, RandomStream::position_noise}, step};
}
Gaussians with_noise(const Gaussians& from, const PositionNoise& noise) {
  TrainingModel model = model_of(from);
  add_noise(model, noise, kRate);
  return copy_of(model.gaussians);
}

TEST(Regularize, AddsToTheGradientsOfScaleAndOpacityAndToNoOthers) {
  const TrainingModel model = model_of(some_gaussians(4, 0.5f));
  Gaussians gradients = copy_of(model.gaussians);
  const auto number = [](const char*, const auto& array) { number_rows(array, 1); };
  for_each_array(number, gradients);
  regularize(model, {0.4f, 0.6f}, gradients);
  for (std::size_t i = 0; i < 4; ++i) {
    const float before = float(i + 1);
    EXPECT_NEAR(gradients.logit_opacity[i], before + 0.4f / 4 * 0.25f, 1e-6f);  // o (1 - o)
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(gradients.log_scale[i][axis], before + 0.6f / 12 * 0.5f, 1e-6f);
    EXPECT_TRUE(row_is(gradients.mean, i, before));
    EXPECT_TRUE(row_is(gradients.rotation, i, before));
    EXPECT_TRUE(row_is(gradients.sh0, i, before));
    EXPECT_TRUE(row_is(gradients.sh_rest, i, before));
  }
}

TEST(AddNoise, MovesFaintMeansByTheirCovarianceAndNothingElse) {
  constexpr std::size_t kCount = 20000;
  const Gaussians before = some_gaussians(kCount, 1e-4f);
  Gaussians after = with_noise(before, noise_of(1, 7));
  double square = 0, sum = 0;
  for (std::size_t i = 0; i < kCount; ++i) {
    sum += after.mean[i].y / double(kCount);
    square += double(after.mean[i].y) * after.mean[i].y / double(kCount);
  }
  // rate * scale * gate * sigma^2, standard error 0.5 percent
  const double gate = 1 / (1 + std::exp(100 * (1e-4 - 0.005)));
  const double expected = 1e-3 * 2 * gate * 0.25;
  EXPECT_NEAR(std::sqrt(square), expected, 0.02 * expected);
  EXPECT_NEAR(sum, 0, 4 * expected / std::sqrt(double(kCount)));
  after.mean = copy_of(before).mean;
  EXPECT_TRUE(same_bits(after, before));
}

TEST(AddNoise, LeavesOpaqueMeansAlone) {
  const Gaussians before = some_gaussians(100, 0.9f);
  const Gaussians after = with_noise(before, noise_of(1, 7));
  for (std::size_t i = 0; i < 100; ++i) EXPECT_LT(std::abs(after.mean[i].y), 1e-30f);
}

TEST(AddNoise, DrawsBySeedStepAndRowAlone) {
  const Gaussians few = some_gaussians(100, 1e-4f), many = some_gaussians(9000, 1e-4f);
  const Gaussians a = with_noise(few, noise_of(1, 7));
  const Gaussians b = with_threads(1, [&] { return with_noise(many, noise_of(1, 7)); });
  const Gaussians later = with_noise(few, noise_of(1, 8)), other = with_noise(few, noise_of(2, 7));
  for (std::size_t i = 0; i < 100; ++i) {
    EXPECT_EQ(a.mean[i], b.mean[i]);
    EXPECT_NE(a.mean[i], later.mean[i]);
    EXPECT_NE(a.mean[i], other.mean[i]);
  }
}

}  // namespace
}  // namespace gs
