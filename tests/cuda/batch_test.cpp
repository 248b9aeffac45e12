// SPDX-License-Identifier: Apache-2.0
// The fused step by several photos, which share one update, against the scalar backend.
#include "tests/cuda/fused_step.h"
#include "tests/support/lens_scenes.h"

namespace gs {
namespace {

using CudaBatch = FusedStepTest;

TEST_F(CudaBatch, ABatchIsThatOfTheScalarBackend) {
  const std::vector<View> views = some_views(131, 77, 3);
  for (const bool has_time : {false, true})
    for (const int degree : {0, 1, 3}) {
      SCOPED_TRACE(degree);
      RenderSettings settings;
      settings.sh_degree = degree;
      settings.absolute_gradient = degree == 1;
      std::vector<TrainingPhoto> batch = batch_of(views, settings);
      for (std::size_t i = 0; i < batch.size(); ++i)
        batch[i].settings.background = {0.1f * float(i), 0.6f, 0.9f};
      Gaussians start = random_gaussians(kTypical, 3000, views[0].camera, std::uint64_t(degree));
      if (has_time) start = in_spacetime(start, 8);
      TrainingModel expected = model_of(start);
      TrainingModel fused = on_gpu(expected);
      Update update{kRates, batch_rule(3)};
      if (has_time) update.rates.right_rotation = update.rates.time_mean = 1e-3f;
      const DensityStep density{.gather_statistics = true, .regularizers = {1e-3f, 1e-3f}};
      batches_both(3, expected, fused, batch, update, density);
      EXPECT_EQ(fused.adam_steps, 9);
      expect_same(on_host(fused), expected, 2e-2);
    }
}

TEST_F(CudaBatch, ABatchOfLensesAndAPinholeIsThatOfTheScalarBackend) {
  std::vector<View> views = some_views(131, 77, 3);
  views[0].camera = with_lens(views[0].camera, CameraModel::simple_fisheye, {0.6, 0.5, 0.4},
                              {{0.08f, -0.1f, 0.12f}, {0.15f, -0.1f, 0.2f}});
  views[1].camera = with_lens(views[1].camera, CameraModel::opencv,
                              {0.9, 0.9, 0.5, 0.5, -0.25, 0.05, 2e-3, -3e-3});
  for (const bool has_time : {false, true}) {
    SCOPED_TRACE(has_time);
    Gaussians start = random_gaussians(kTypical, 3000, views[2].camera, 4);
    if (has_time) start = in_spacetime(start, 8);
    TrainingModel expected = model_of(start);
    TrainingModel fused = on_gpu(expected);
    const std::vector<TrainingPhoto> batch = batch_of(views, {});
    batches_both(3, expected, fused, batch, {kRates, batch_rule(3)}, {.gather_statistics = true});
    expect_same(on_host(fused), expected, 2e-2);
  }
}

// The gradients of four photos are copied at a time. In space and time each photo has its own.
TEST_F(CudaBatch, BatchesOfAllSizesAreThoseOfTheScalarBackend) {
  std::vector<View> views = some_views(131, 77, kMostBatch);
  for (std::size_t i = 0; i < views.size(); ++i) views[i].camera.time = 0.1f * float(i);
  for (const bool has_time : {false, true})
    for (const std::size_t size : {2, 4, 5, 8}) {
      SCOPED_TRACE(testing::Message() << size << (has_time ? " in time" : ""));
      std::vector<TrainingPhoto> batch = batch_of(views, {});
      batch.resize(size);
      Gaussians start = random_gaussians(kTypical, 3000, views[0].camera, 4);
      if (has_time) start = in_spacetime(start, 8);
      TrainingModel expected = model_of(start);
      TrainingModel fused = on_gpu(expected);
      const DensityStep density{.gather_statistics = true, .score = GrowthScore::force};
      batches_both(3, expected, fused, batch, {kRates, batch_rule(int(size))}, density);
      expect_same(on_host(fused), expected, 2e-2);
    }
}

// Sums over fragments are those of all photos, among the gradients or, if deterministic, apart.
TEST_F(CudaBatch, ABatchSumsForcesAsTheScalarBackendDoes) {
  const std::vector<View> views = some_views(131, 77, 6);
  for (const bool is_deterministic : {false, true}) {
    SCOPED_TRACE(is_deterministic);
    RenderSettings settings;
    settings.deterministic = is_deterministic;
    std::vector<TrainingPhoto> batch = batch_of(views, settings);
    batch[1].reduction = 2;
    TrainingModel expected = model_of(random_gaussians(kTypical, 3000, views[0].camera, 4));
    TrainingModel fused = on_gpu(expected);
    const DensityStep density{.gather_statistics = true, .score = GrowthScore::force};
    batches_both(1, expected, fused, batch, {kRates, batch_rule(6)}, density);
    expect_same_sums(on_host(fused), expected, 1e-2);
  }
}

TEST_F(CudaBatch, ShMayRiseByADegreeBetweenTwoPhotos) {
  const std::vector<View> views = some_views(131, 77, 3);
  std::vector<TrainingPhoto> batch = batch_of(views, {});
  batch[0].settings.sh_degree = 1;
  batch[1].settings.sh_degree = batch[2].settings.sh_degree = 2;
  TrainingModel expected = model_of(random_gaussians(kTypical, 3000, views[0].camera, 5));
  TrainingModel fused = on_gpu(expected);
  batches_both(2, expected, fused, batch, {kRates, batch_rule(3)}, {true});
  expect_same(on_host(fused), expected, 2e-2);
}

TEST_F(CudaBatch, ABatchWithA3dFilterIsThatOfTheScalarBackend) {
  const std::vector<View> views = some_views(131, 77, 3);
  const std::vector<TrainingPhoto> batch = batch_of(views, {});
  TrainingModel expected =
      model_of(with_filters(random_gaussians(kTypical, 3000, views[0].camera, 1), 9));
  TrainingModel fused = on_gpu(expected);
  batches_both(3, expected, fused, batch, {kRates}, {true});
  expect_same(on_host(fused), expected, 2e-2);
}

// Regularizers have gradients of every row, also where no photo of the batch shows 32 rows in turn.
TEST_F(CudaBatch, ABatchRegularizesRowsThatItsPhotosDoNotShow) {
  const std::vector<View> views = some_views(131, 77, 3);
  Gaussians start = random_gaussians(kTypical, 300, views[0].camera, 1);
  for (std::size_t i = 64; i < start.count(); ++i)
    start.mean[i] = behind_pixel(views[0].camera, 60, 40, -5);  // behind the camera
  const std::vector<TrainingPhoto> batch = batch_of(views, {});
  TrainingModel expected = model_of(start);
  TrainingModel fused = on_gpu(expected);
  const DensityStep density{.gather_statistics = true, .regularizers = {1e-2f, 1e-2f}};
  batches_both(4, expected, fused, batch, {kRates}, density);
  expect_same(on_host(fused), expected, 1e-2);
}

// The buffers are too small for some photos of a batch, which is then taken again as a whole.
TEST_F(CudaBatch, ABatchWithTooLittleRoomLosesNothing) {
  const std::vector<View> views = some_views(320, 240, 3);
  const Recipe large{
      .sigma_low = 30, .sigma_high = 60, .opacity_low = 0.02f, .opacity_high = 0.05f};
  const TrainingModel start = model_of(random_gaussians(large, 20000, views[0].camera, 3));
  for (const bool is_deterministic : {false, true}) {
    SCOPED_TRACE(is_deterministic);
    RenderSettings settings;
    settings.deterministic = is_deterministic;
    const std::vector<TrainingPhoto> batch = batch_of(views, settings);
    const DensityStep density{.gather_statistics = true, .score = GrowthScore::force};
    TrainingModel again = on_gpu(start), fused = on_gpu(start);
    // Steps of the first model find buffers that are too small; those of the second do not.
    gpu().device().upload_views(views, std::size_t(1) << 30);
    for (TrainingModel* const model : {&again, &fused}) {
      for (int step = 0; step < 6; ++step)
        gpu().step(*model, {{batch.data(), batch.size()}, {0.2f}, {kRates}, density});
      gpu().synchronize(*model);
    }
    expect_same(on_host(again), on_host(fused), 2e-2);
    expect_same_sums(on_host(again), on_host(fused), 2e-2);
  }
}

// Each photo of a batch is copied while the one before it is trained on.
TEST_F(CudaBatch, StreamedPhotosGiveTheSameBatches) {
  const std::vector<View> views = some_views(200, 150, 7);
  const TrainingModel start = model_of(random_gaussians(kTypical, 5000, views[0].camera, 7));
  TrainingModel streamed = on_gpu(start), resident = on_gpu(start);
  const std::vector<TrainingPhoto> batch = batch_of(views, {});
  for (TrainingModel* model : {&streamed, &resident}) {
    gpu().device().upload_views(views, model == &streamed ? 0 : 1 << 30);
    for (int step = 0; step < 10; ++step) {
      gpu().device().prefetch_next(views[0]);
      gpu().step(*model, {{batch.data(), batch.size()}, {0.2f}, {kRates}, {}});
    }
    gpu().synchronize(*model);
  }
  EXPECT_LT(norm_difference(downloaded(streamed.gaussians.sh0), downloaded(resident.gaussians.sh0)),
            1e-3);
}

}  // namespace
}  // namespace gs
