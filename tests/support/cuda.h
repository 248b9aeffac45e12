// SPDX-License-Identifier: Apache-2.0
// What tests of the CUDA backend share: they are skipped, with a reason, where there is no GPU.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "cuda/backend.h"
#include "tests/support/models.h"

namespace gs {

/// A test with the CUDA backend and the scalar one beside it.
class CudaTest : public testing::Test {
 protected:
  void SetUp() override {
    if (cuda::device_count() == 0) GTEST_SKIP() << "the driver reports no GPU";
    gpu_ = cuda::make_backend(0);
    cpu_ = make_scalar_backend();
  }
  Backend& gpu() { return *gpu_; }
  Backend& cpu() { return *cpu_; }

  /// A model of the GPU with the same contents.
  TrainingModel on_gpu(const TrainingModel& from) {
    TrainingModel model(gpu().memory());
    const auto copy = [](const char*, auto& to, const auto& array) { to.upload(array.download()); };
    for_each_array(copy, model.gaussians, from.gaussians);
    for_each_array(copy, model.first_moment, from.first_moment);
    for_each_array(copy, model.second_moment, from.second_moment);
    model.statistics.visits.upload(from.statistics.visits.download());
    model.statistics.gradient_norm.upload(from.statistics.gradient_norm.download());
    model.adam_steps = from.adam_steps;
    return model;
  }
  /// And back, in host memory.
  TrainingModel on_host(const TrainingModel& from) {
    TrainingModel model;
    const auto copy = [](const char*, auto& to, const auto& array) { to.upload(array.download()); };
    for_each_array(copy, model.gaussians, from.gaussians);
    for_each_array(copy, model.first_moment, from.first_moment);
    for_each_array(copy, model.second_moment, from.second_moment);
    model.statistics.visits.upload(from.statistics.visits.download());
    model.statistics.gradient_norm.upload(from.statistics.gradient_norm.download());
    model.adam_steps = from.adam_steps;
    return model;
  }

 private:
  std::unique_ptr<Backend> gpu_, cpu_;
};

/// Largest difference of two arrays of numbers, over the largest absolute value of `expected`.
inline double relative_difference(const std::vector<float>& actual,
                                  const std::vector<float>& expected) {
  EXPECT_EQ(actual.size(), expected.size());
  double difference = 0, scale = 0;
  for (std::size_t i = 0; i < std::min(actual.size(), expected.size()); ++i) {
    if (!(std::abs(double(actual[i]) - expected[i]) <= difference))  // catches NaN
      difference = std::abs(double(actual[i]) - expected[i]);
    scale = std::max(scale, std::abs(double(expected[i])));
  }
  return scale > 0 ? difference / scale : difference;
}
/// The numbers of an array of any Memory, in host memory.
template <class T>
std::vector<float> downloaded(const Buffer<T>& array) {
  const std::vector<T> rows = array.download();
  std::vector<float> numbers(rows.size() * sizeof(T) / sizeof(float));
  if (!rows.empty()) std::memcpy(numbers.data(), rows.data(), rows.size() * sizeof(T));
  return numbers;
}

}  // namespace gs
