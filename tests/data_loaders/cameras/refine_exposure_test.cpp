// SPDX-License-Identifier: Apache-2.0
// Exposures from synthetic colors whose true exposures are known, and from photos of a small scene.
#include "data_loaders/refine/refine_exposure.h"

#include <gmock/gmock.h>

#include <cmath>

#include "data_loaders/photos/encode/encode_png.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_core/error.h"
#include "gs_core/math/random.h"
#include "gs_core/threads/parallel.h"
#include "tests/support/colmap_writer.h"

namespace gs {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr std::size_t kPhotos = 12;
constexpr std::uint32_t kPoints = 600;
const Random kRandom{11, RandomStream::test};

/// Gains between 0.7 and 1.4 that differ in each channel; their geometric mean over all but the
/// test photos is 1.
std::vector<Vec3f> true_exposures(const std::vector<bool>& is_test) {
  std::vector<Vec3f> exposures;
  Vec3d sum(0.0);
  double count = 0;
  for (std::size_t i = 0; i < is_test.size(); ++i) {
    const Vec4f u = kRandom.uniform4(1000000 + i);
    exposures.push_back({0.7f + 0.7f * u.x, 0.7f + 0.7f * u.y, 0.7f + 0.7f * u.z});
    if (is_test[i]) continue;
    for (int c = 0; c < 3; ++c) sum[c] += std::log(double(exposures[i][c]));
    ++count;
  }
  for (Vec3f& exposure : exposures)
    for (int c = 0; c < 3; ++c) exposure[c] *= float(std::exp(-sum[c] / count));
  return exposures;
}

/// Each photo shows a third of the points, and neighbors show mostly the same ones, with one
/// percent of noise.
std::vector<ColorSample> samples_under(const std::vector<Vec3f>& exposures) {
  std::vector<ColorSample> samples;
  for (std::uint32_t photo = 0; photo < exposures.size(); ++photo)
    for (std::uint32_t k = 0; k < kPoints / 3; ++k) {
      const std::uint32_t point =
          (photo * (kPoints / std::uint32_t(exposures.size())) + k) % kPoints;
      const Vec4f albedo = kRandom.uniform4(point),
                  noise = kRandom.uniform4(10000 + photo * kPoints + k);
      Vec3f color;
      for (int c = 0; c < 3; ++c)
        color[c] = (0.15f + 0.45f * albedo[c]) * exposures[photo][c] * (0.99f + 0.02f * noise[c]);
      samples.push_back({photo, point, color});
    }
  return samples;
}

double worst_error(const ExposureFit& fit, const std::vector<Vec3f>& truth) {
  double worst = 0;
  for (std::size_t i = 0; i < truth.size(); ++i)
    for (int c = 0; c < 3; ++c)
      worst = std::max(worst, std::abs(double(fit.exposures[i][c]) / truth[i][c] - 1));
  return worst;
}

TEST(RefineExposure, KnownGainsAreFoundWithinOnePercentDespiteOutliersAndSaturation) {
  std::vector<bool> is_test(kPhotos, false);
  is_test[3] = is_test[8] = true;
  const std::vector<Vec3f> truth = true_exposures(is_test);
  std::vector<ColorSample> samples = samples_under(truth);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const Vec4f u = kRandom.uniform4(20000000 + i);
    // a color of something else
    if (u.w < 0.1f) samples[i].color = {0.05f + 0.9f * u.x, 0.05f + 0.9f * u.y, 0.05f + 0.9f * u.z};
    // values flatten near white
    for (int c = 0; c < 3; ++c) samples[i].color[c] = std::min(samples[i].color[c], 0.7f);
  }
  const ExposureFit fit = fit_exposures(samples, is_test);
  EXPECT_LT(worst_error(fit, truth), 0.01);
  EXPECT_TRUE(fit.unknown.empty());
  EXPECT_EQ(fit.sample_count, samples.size());
}

TEST(RefineExposure, SpreadFallsToTheNoiseAndIsKeptWhereThereIsNothingToExplain) {
  const std::vector<bool> is_test(kPhotos, false);
  const ExposureFit fit = fit_exposures(samples_under(true_exposures(is_test)), is_test);
  EXPECT_GT(fit.spread_before, 0.1);
  EXPECT_LT(fit.spread_after, 0.012);  // the noise is uniform in one percent
  const ExposureFit even =
      fit_exposures(samples_under(std::vector<Vec3f>(kPhotos, Vec3f(1))), is_test);
  EXPECT_LT(worst_error(even, std::vector<Vec3f>(kPhotos, Vec3f(1))), 0.003);
}

TEST(RefineExposure, TestPhotosHaveNoInfluenceOnTheOthers) {
  std::vector<bool> is_test(kPhotos, false);
  is_test[5] = true;
  const std::vector<ColorSample> samples = samples_under(true_exposures(is_test));
  std::vector<ColorSample> changed = samples;
  for (ColorSample& sample : changed)
    if (sample.photo == 5) sample.color = sample.color * 0.5f;
  const ExposureFit a = fit_exposures(samples, is_test), b = fit_exposures(changed, is_test);
  for (std::size_t i = 0; i < kPhotos; ++i) {
    if (i == 5) continue;
    EXPECT_EQ(a.exposures[i], b.exposures[i]) << i;
  }
  EXPECT_NEAR(b.exposures[5].x / a.exposures[5].x, 0.5, 1e-3);
}

TEST(RefineExposure, PhotoThatSharesNothingStaysAsItIsAndIsNamed) {
  const std::vector<bool> is_test(kPhotos, false);
  std::vector<ColorSample> samples = samples_under(true_exposures(is_test));
  for (ColorSample& sample : samples)
    if (sample.photo == 4) sample.point += kPoints;
  const ExposureFit fit = fit_exposures(samples, is_test);
  EXPECT_THAT(fit.unknown, testing::ElementsAre(4u));
  EXPECT_EQ(fit.exposures[4], Vec3f(1));
  EXPECT_EQ(fit_exposures({}, is_test).unknown.size(), kPhotos);
}

TEST(RefineExposure, IsTheSameOnEveryNumberOfThreads) {
  const std::vector<bool> is_test(kPhotos, false);
  const std::vector<ColorSample> samples = samples_under(true_exposures(is_test));
  const int threads = thread_count();
  set_thread_count(1);
  const ExposureFit one = fit_exposures(samples, is_test);
  set_thread_count(3);
  const ExposureFit three = fit_exposures(samples, is_test);
  set_thread_count(threads);
  EXPECT_EQ(one.exposures, three.exposures);
}

// --- From photos

/// Eight photos of one textured wall at z = 2, from cameras that stand a little apart, each with
/// its own exposure.
ColmapModel wall_model() {
  ColmapModel model;
  model.cameras[1] = {1, CameraModel::pinhole, 120, 90, {100, 100, 60, 45}};
  for (std::uint64_t p = 0; p < 300; ++p) {
    const Vec4f u = kRandom.uniform4(500 + p);
    model.points.push_back(
        {p + 1, {double(u.x) * 1.6 - 0.6, double(u.y) * 1.4 - 0.7, 2.0}, {9, 9, 9}});
  }
  for (std::uint32_t i = 0; i < 8; ++i) {
    ColmapImage image{
        i + 1, std::string(1, char('a' + i)) + ".png", 1, {1, 0, 0, 0}, {-0.05 * i, 0.0, 0.0}};
    for (const ColmapPoint& point : model.points)
      image.observations.push_back(
          {point.id, 60 + 50 * (point.position.x - 0.05 * i), 45 + 50 * point.position.y});
    model.images.push_back(image);
  }
  return model;
}

void write_wall(const std::filesystem::path& folder, const ColmapModel& model,
                const std::vector<Vec3f>& exposures) {
  write_binary_model(folder / "sparse" / "0", model);
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    Image8 photo(120, 90, 3);
    for (int y = 0; y < 90; ++y)
      for (int x = 0; x < 120; ++x)
        for (int c = 0; c < 3; ++c) {
          const double wall_x = (x + 0.5 - 60) / 50 + 0.05 * double(i),
                       wall_y = (y + 0.5 - 45) / 50;
          const double color =
              0.4 + 0.15 * std::sin(7 * wall_x + c) + 0.1 * std::sin(9 * wall_y - c);
          photo.at(x, y, c) =
              std::uint8_t(std::lround(255 * std::min(1.0, color * double(exposures[i][c]))));
        }
    write_png(folder / "images" / model.images[i].name, photo);
  }
}

TEST(RefineExposure, OfPhotosIsThatOfTheirPixelsInTrainingAndTestViews) {
  const TempFolder temp;
  std::vector<bool> is_test(8, false);
  is_test[0] = is_test[4] = true;
  const std::vector<Vec3f> truth = true_exposures(is_test);
  write_wall(temp.path(), wall_model(), truth);
  DatasetConfig dataset;
  dataset.source = temp.path().string();
  dataset.eval = dataset.exposure = true;
  dataset.test_every = 4;
  const Scene scene = load_scene(dataset);
  ASSERT_EQ(scene.test_views.size(), 2u);
  ASSERT_TRUE(scene.exposure);
  EXPECT_LT(scene.exposure->spread_after, 0.02);
  for (const auto* views : {&scene.train_views, &scene.test_views})
    for (const View& view : *views)
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(view.exposure[c] / truth[std::size_t(view.name[0] - 'a')][c], 1, 0.01)
            << view.name;
  dataset.exposure = false;
  EXPECT_EQ(load_scene(dataset).train_views[0].exposure, Vec3f(1));
}

TEST(RefineExposure, OfListedPhotosIsThatOfTheWholeScene) {
  const TempFolder temp;
  write_wall(temp.path(), wall_model(), true_exposures(std::vector<bool>(8, false)));
  DatasetConfig dataset;
  dataset.source = temp.path().string();
  dataset.exposure = true;
  const Scene whole = load_scene(dataset);
  write_bytes(temp.path() / "list.txt", "b\nc\nf\n");
  dataset.photo_list = (temp.path() / "list.txt").string();
  const Scene part = load_scene(dataset);
  ASSERT_EQ(part.train_views.size(), 3u);
  for (const View& view : part.train_views) {
    EXPECT_NE(view.exposure, Vec3f(1));
    EXPECT_EQ(view.exposure, whole.train_views[std::size_t(view.name[0] - 'a')].exposure);
  }
}

TEST(RefineExposure, SamplesNearBlackOrWhiteOutsideThePictureOrBehindTheCameraAreLeftOut) {
  View view;
  view.camera.width = 40, view.camera.height = 10;
  view.camera.fx = view.camera.fy = 10, view.camera.cx = 20, view.camera.cy = 5;
  view.photo = Image8(40, 10, 3, 128);
  // one channel is enough
  for (int y = 0; y < 10; ++y)
    for (int x = 0; x < 20; ++x) view.photo.at(x, y, 1) = x < 10 ? 3 : 252;
  const auto at_column = [](float x) { return ScenePoint{{(x - 20) / 10 * 2, 0, 2}, {}}; };
  const std::vector<ScenePoint> points = {at_column(5),  at_column(15),    at_column(30),
                                          at_column(41), {{0, 0, -2}, {}}, at_column(25)};
  const std::vector<ColorSample> samples = sample_colors(view, 7, points, {0, 1, 2, 3, 4});
  ASSERT_EQ(samples.size(), 1u);
  EXPECT_EQ(samples[0].photo, 7u);
  EXPECT_EQ(samples[0].point, 2u);
  EXPECT_FLOAT_EQ(samples[0].color.y, 128 / 255.0f);
}

TEST(RefineExposure, ModelWithoutTracksIsRefusedWithAdvice) {
  const TempFolder temp;
  write_scene(temp.path(), small_model(3));
  DatasetConfig dataset;
  dataset.source = temp.path().string();
  dataset.exposure = true;
  try {
    load_scene(dataset);
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(),
                AllOf(HasSubstr("POINTS2D"), HasSubstr("--exposure"), HasSubstr("dataset.model")));
  }
}

}  // namespace
}  // namespace gs
