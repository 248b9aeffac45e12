// SPDX-License-Identifier: Apache-2.0
// The fused step on photos that are reduced while they are trained on, against the scalar backend.
#include "tests/cuda/fused_step.h"

namespace gs {
namespace {

using CudaReducedPhoto = FusedStepTest;

// With a mask, with alpha and an exposure, and plain; the sides are no multiples of the factors.
TEST_F(CudaReducedPhoto, AStepOnAReducedPhotoIsTheScalarOne) {
  const std::vector<View> views = some_views(263, 155, 3);
  for (const bool is_resident : {true, false})
    for (const int reduction : {2, 3, 4}) {
      SCOPED_TRACE(reduction);
      gpu().device().upload_views(views, is_resident ? 1 << 30 : 0);
      RenderSettings settings;
      settings.sh_degree = reduction - 1;
      settings.background = {0.3f, 0.6f, 0.9f};
      TrainingModel expected =
          model_of(random_gaussians(kTypical, 3000, views[0].camera, std::uint64_t(reduction)));
      TrainingModel fused = on_gpu(expected);
      for (const View& view : views) {
        const TrainingPhoto photo{&view, settings, reduction};
        cpu().step(expected, {{&photo, 1}, {0.2f}, {kRates}, {true}});
        gpu().step(fused, {{&photo, 1}, {0.2f}, {kRates}, {true}});
      }
      gpu().synchronize(fused);
      EXPECT_NEAR(gpu().loss().value(), cpu().loss().value(), 2e-3 * cpu().loss().value());
      expect_same(on_host(fused), expected, 1e-2);
    }
  gpu().device().upload_views({}, 0);  // these views end here
}

// A batch over the end of a stage has photos of both sizes.
TEST_F(CudaReducedPhoto, ABatchOfPhotosOfTwoSizesIsThatOfTheScalarBackend) {
  const std::vector<View> views = some_views(263, 155, 3);
  gpu().device().upload_views(views, 1 << 30);
  std::vector<TrainingPhoto> batch = batch_of(views, {});
  batch[0].reduction = batch[1].reduction = 4;
  TrainingModel expected = model_of(random_gaussians(kTypical, 3000, views[0].camera, 2));
  TrainingModel fused = on_gpu(expected);
  batches_both(3, expected, fused, batch, {kRates}, {true});
  expect_same(on_host(fused), expected, 2e-2);
  gpu().device().upload_views({}, 0);
}

// Where photos become larger a view has several times as many instances as at its last visit.
TEST_F(CudaReducedPhoto, ARampOfResolutionsLosesNothing) {
  const std::vector<View> views = some_views(640, 480, 3);
  const Recipe large{
      .sigma_low = 40, .sigma_high = 90, .opacity_low = 0.02f, .opacity_high = 0.05f};
  const TrainingModel start = model_of(random_gaussians(large, 20000, views[0].camera, 3));
  TrainingModel ramped = on_gpu(start), again = on_gpu(start);
  gpu().device().upload_views(views, 1 << 30);
  const auto photo_of = [&](int step) {
    return TrainingPhoto{&views[std::size_t(step % 3)], {}, step < 6 ? 8 : step < 12 ? 4 : 1};
  };
  // Steps of the second model know how many instances the large photos have.
  for (TrainingModel* const model : {&ramped, &again}) {
    for (int step = 0; step < 18; ++step) {
      const TrainingPhoto photo = photo_of(step);
      gpu().step(*model, {{&photo, 1}, {0.2f}, {kRates}, {true}});
    }
    gpu().synchronize(*model);
  }
  EXPECT_EQ(ramped.adam_steps, 18);
  expect_same(on_host(ramped), on_host(again), 2e-2);
  gpu().device().upload_views({}, 0);
}

}  // namespace
}  // namespace gs
