// SPDX-License-Identifier: Apache-2.0
// Vignetting and exposures from synthetic colors whose true ones are known.
#include "data_loaders/refine/refine_vignetting.h"

#include <gmock/gmock.h>

#include <cmath>

#include "data_loaders/refine/refine_exposure.h"
#include "gs_core/math/photometric.h"
#include "gs_core/random.h"
#include "gs_core/threads/parallel.h"

namespace gs {
namespace {

constexpr std::uint32_t kPhotos = 24, kPoints = 900;
const Random kRandom{13, RandomStream::test};

/// cos^4 of the angle from the axis, for the cameras 1 to 3: corners of 100, 59 and 35 %.
float true_vignetting(std::uint32_t camera, float rho) {
  constexpr float kTan2[] = {0, 0.3f, 0.7f};
  return 2 * std::log1p(kTan2[camera - 1] * rho);
}
float true_gain(std::uint32_t photo) { return 0.3f * kRandom.uniform4(500 + photo).x - 0.15f; }

/// Each photo shows a third of the points anywhere on its lens, with one percent of noise.
std::vector<ColorSample> samples_of(bool has_vignetting) {
  std::vector<ColorSample> samples;
  for (std::uint32_t photo = 0; photo < kPhotos; ++photo)
    for (std::uint32_t k = 0; k < kPoints / 3; ++k) {
      const std::uint32_t point = (photo * (kPoints / kPhotos) + k) % kPoints;
      const Vec4f albedo = kRandom.uniform4(point);
      const Vec4f u = kRandom.uniform4(10000 + photo * kPoints + k);
      ColorSample sample{photo, point, Vec3f(0), photo % 3 + 1, u.w};
      const float B = has_vignetting ? true_vignetting(sample.camera, sample.rho) : 0.0f;
      for (int c = 0; c < 3; ++c)
        sample.color[c] =
            gained((0.2f + 0.4f * albedo[c]) * (0.99f + 0.02f * u[c]), true_gain(photo), B);
      samples.push_back(sample);
    }
  return samples;
}

float corner(const std::array<float, 3>& b) {
  return log_vignetting(b, 1.0f) - log_vignetting(b, 0.0f);
}

TEST(RefineVignetting, OfThreeLensesIsFoundWithinOnePercentDespiteOutliers) {
  std::vector<ColorSample> samples = samples_of(true);
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (const Vec4f u = kRandom.uniform4(20000000 + i); u.w < 0.1f)
      samples[i].color = {0.05f + 0.9f * u.x, 0.05f + 0.9f * u.y, 0.05f + 0.9f * u.z};
  const Lenses lenses = fit_vignetting(samples, std::vector<bool>(kPhotos, false));
  ASSERT_EQ(lenses.size(), 3u);
  for (const auto& [camera, b] : lenses)
    EXPECT_NEAR(corner(b), true_vignetting(camera, 1), 0.012) << camera;
}

TEST(RefineVignetting, LeavesExposuresThatAreRight) {
  const std::vector<bool> is_test(kPhotos, false);
  const std::vector<ColorSample> samples = samples_of(true);
  const Lenses lenses = fit_vignetting(samples, is_test);
  const ExposureFit with = fit_exposures(without_vignetting(samples, lenses), is_test);
  const ExposureFit without = fit_exposures(samples, is_test);
  EXPECT_LT(with.spread_after, 0.012);  // the noise
  EXPECT_GT(without.spread_after, 3 * with.spread_after);
  // A photo of a lens that darkens is darker in the mean, which is part of its gain.
  const auto mean_gain = [&](std::uint32_t photo) {
    double sum = 0;
    for (int i = 0; i < 100; ++i) sum += true_vignetting(photo % 3 + 1, 0.01f * (float(i) + 0.5f));
    return true_gain(photo) - sum / 100;
  };
  double mean = 0;
  for (std::uint32_t i = 0; i < kPhotos; ++i)
    mean += (std::log(double(with.exposures[i].x)) - mean_gain(i)) / kPhotos;
  for (std::uint32_t i = 0; i < kPhotos; ++i)
    EXPECT_NEAR(std::log(double(with.exposures[i].x)) - mean_gain(i), mean, 0.01) << i;
}

TEST(RefineVignetting, IsHardlyAnyWhereThereIsNone) {
  for (const auto& [camera, b] :
       fit_vignetting(samples_of(false), std::vector<bool>(kPhotos, false)))
    EXPECT_NEAR(corner(b), 0, 0.005) << camera;
}

TEST(RefineVignetting, OfALensThatBrightensItsCornersIsNone) {
  std::vector<ColorSample> samples = samples_of(false);
  for (ColorSample& sample : samples) sample.color = (0.7f + 0.3f * sample.rho) * sample.color;
  for (const auto& [camera, b] : fit_vignetting(samples, std::vector<bool>(kPhotos, false)))
    EXPECT_THAT(b, testing::Each(0.0f)) << camera;
}

TEST(RefineVignetting, DoesNotSeeTestPhotosAndIsTheSameOnEveryNumberOfThreads) {
  std::vector<bool> is_test(kPhotos, false);
  is_test[5] = true;
  const std::vector<ColorSample> samples = samples_of(true);
  std::vector<ColorSample> changed = samples;
  for (ColorSample& sample : changed)
    if (sample.photo == 5) sample.color = sample.rho * sample.color;
  const int threads = thread_count();
  set_thread_count(1);
  const Lenses one = fit_vignetting(samples, is_test);
  set_thread_count(3);
  EXPECT_EQ(fit_vignetting(changed, is_test), one);
  set_thread_count(threads);
}

}  // namespace
}  // namespace gs
