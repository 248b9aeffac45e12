// SPDX-License-Identifier: Apache-2.0
// Stage 8 on the GPU: the dense update against the scalar twin.
#include <gtest/gtest.h>

#include "tests/support/cuda.h"

namespace gs {
namespace {

constexpr LearningRates kRates{1e-4f, 2e-3f, 3e-3f, 4e-2f, 5e-3f, 6e-4f};
constexpr double kTolerance = 1e-5;  // of the largest number of an array, after kSteps steps
constexpr int kSteps = 20;

constexpr float kZeros = 0.1f;  // share of zero gradients, as in rows that no view sees

class CudaAdam : public CudaTest {
 protected:
  void step_both(TrainingModel& host, TrainingModel& device, const Gaussians& gradients) {
    const TrainingModel on_device = on_gpu(model_of(gradients));
    cpu().optimizer().step(host, gradients, {kRates});
    gpu().optimizer().step(device, on_device.gaussians, {kRates});
  }
};

TrainingModel random_model(std::size_t count, std::uint64_t seed) {
  return model_of(random_gaussians(kTypical, count, random_camera(40, 30), seed));
}

void expect_same(const Gaussians& actual, const Gaussians& expected) {
  for_each_array(
      [](const char* name, const auto& a, const auto& b) {
        EXPECT_LT(relative_difference(downloaded(a), downloaded(b)), kTolerance) << name;
      },
      actual, expected);
}

TEST_F(CudaAdam, UpdatesParametersAndMomentsAsTheScalarTwin) {
  TrainingModel host = random_model(1001, 1);
  TrainingModel device = on_gpu(host);
  for (int step = 0; step < kSteps; ++step)
    step_both(host, device, random_gradients(1001, std::uint64_t(step) + 2, kZeros));
  expect_same(device.gaussians, host.gaussians);
  expect_same(opened(device).first, opened(host).first);
  expect_same(opened(device).second, opened(host).second);
}

TEST_F(CudaAdam, CountsItsSteps) {
  TrainingModel host = random_model(3, 1);
  host.adam_steps = 17;
  TrainingModel device = on_gpu(host);
  step_both(host, device, random_gradients(3, 2, kZeros));
  EXPECT_EQ(device.adam_steps, 18);
  expect_same(device.gaussians, host.gaussians);
}

TEST_F(CudaAdam, TakesAModelWithoutRows) {
  TrainingModel host = random_model(0, 1);
  TrainingModel device = on_gpu(host);
  step_both(host, device, random_gradients(0, 2, kZeros));
  EXPECT_EQ(device.count(), 0u);
  EXPECT_EQ(device.adam_steps, 1);
}

}  // namespace
}  // namespace gs
