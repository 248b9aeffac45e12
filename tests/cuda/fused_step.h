// SPDX-License-Identifier: Apache-2.0
// What the tests of the fused step share: views, batches, and both backends side by side.
#pragma once

#include "tests/support/cuda.h"

namespace gs {

inline std::vector<View> some_views(int width, int height, int count) {
  std::vector<View> views(count);
  for (int i = 0; i < count; ++i) {
    views[i].name = "view " + std::to_string(i);
    views[i].camera = random_camera(width, height, 1);
    views[i].camera.cx += float(3 * i);
    views[i].photo = random_photo(width, height, std::uint64_t(i));
    if (i == 1) {  // a photo with a mask, and one with alpha
      views[i].mask = Image8(width, height, 1, 255);
      std::fill_n(views[i].mask.pixels.begin(), std::size_t(width) * height / 3, std::uint8_t(0));
    } else if (i == 2) {
      views[i].mask = Image8(width, height, 1, 150);
      views[i].over_background = true;
      views[i].exposure = {0.9f, 1.0f, 1.1f};
    }
  }
  return views;
}

inline std::vector<TrainingPhoto> batch_of(const std::vector<View>& views,
                                           const RenderSettings& settings) {
  std::vector<TrainingPhoto> batch;
  for (const View& view : views) batch.push_back({&view, settings});
  return batch;
}

/// A test of the step of the GPU that does all at once, beside the scalar one.
class FusedStepTest : public CudaTest {
 protected:
  /// A step of both backends for each view.
  void step_both(TrainingModel& on_cpu, TrainingModel& on_gpu, const std::vector<View>& views,
                 const RenderSettings& settings, const LearningRates& rates,
                 const DensityStep& density) {
    for (const View& view : views) {
      cpu().step(on_cpu, view, settings, {0.2f}, rates, density);
      gpu().step(on_gpu, view, settings, {0.2f}, rates, density);
    }
    gpu().synchronize(on_gpu);
  }
  /// So many updates of both backends by the same batch.
  void batches_both(int updates, TrainingModel& on_cpu, TrainingModel& on_gpu,
                    const std::vector<TrainingPhoto>& batch, const Update& update,
                    const DensityStep& density) {
    for (int i = 0; i < updates; ++i) {
      cpu().step(on_cpu, {{batch.data(), batch.size()}, {0.2f}, update, density});
      gpu().step(on_gpu, {{batch.data(), batch.size()}, {0.2f}, update, density});
    }
    gpu().synchronize(on_gpu);
  }
  void expect_same(const TrainingModel& actual, const TrainingModel& expected, double tolerance) {
    const auto compare = [](const Gaussians& x, const Gaussians& y, double most) {
      for_each_array(
          [&](const char* name, const auto& a, const auto& b) {
            EXPECT_LT(norm_difference(downloaded(a), downloaded(b)), most) << name;
          },
          x, y);
    };
    const OpenedMoments a = opened(actual), b = opened(expected);
    compare(a.first, b.first, tolerance);
    compare(a.second, b.second, 2 * tolerance);
    compare(actual.gaussians, expected.gaussians, tolerance);
    EXPECT_EQ(actual.adam_steps, expected.adam_steps);
    EXPECT_LT(norm_difference(downloaded(actual.statistics.gradient_norm),
                              downloaded(expected.statistics.gradient_norm)),
              tolerance);
    EXPECT_LT(norm_difference(downloaded(actual.statistics.visits),
                              downloaded(expected.statistics.visits)),
              tolerance);
  }
  /// The sums over fragments of both models.
  void expect_same_sums(const TrainingModel& actual, const TrainingModel& expected,
                        double tolerance) {
    const auto numbers = [](const TrainingModel& model, float FragmentSums::*number) {
      std::vector<float> all;
      for (std::size_t i = 0; i < model.count(); ++i)
        all.push_back(model.statistics.sums[i].*number);
      return all;
    };
    for (float FragmentSums::*const number :
         {&FragmentSums::count, &FragmentSums::first, &FragmentSums::second})
      EXPECT_LT(norm_difference(numbers(actual, number), numbers(expected, number)), tolerance);
  }
};

}  // namespace gs
