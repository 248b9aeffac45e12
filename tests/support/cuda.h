// SPDX-License-Identifier: Apache-2.0
// What the tests of the CUDA backend share. Without a GPU they are skipped, with a reason.
#pragma once

#include "cuda/backend.h"
#include "tests/support/scene_run.h"

namespace gs {

/// A test with the CUDA backend and the scalar backend side by side.
class CudaTest : public testing::Test {
 protected:
  void SetUp() override {
    if (cuda::device_count() == 0) GTEST_SKIP() << "the driver reports no GPU";
    gpu_ = cuda::make_backend({0});
    cpu_ = make_scalar_backend();
  }
  Backend& gpu() { return *gpu_; }
  Backend& cpu() { return *cpu_; }

  /// A model of the GPU with the same contents, and back.
  TrainingModel on_gpu(const TrainingModel& from) { return copy_to(gpu().memory(), from); }
  Gaussians on_gpu(const Gaussians& from) {
    return copy_to(gpu().memory(), GaussianModel{copy_of(from), kMaxShDegree, true, false});
  }
  TrainingModel on_host(const TrainingModel& from) { return copy_to(host_memory(), from); }

 private:
  std::unique_ptr<Backend> gpu_, cpu_;
};

/// The largest difference of two arrays of numbers, relative to the largest absolute value of
/// `expected`.
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
/// ||actual - expected|| / ||expected||; infinite if a value is not a number.
inline double norm_difference(const std::vector<float>& actual,
                              const std::vector<float>& expected) {
  EXPECT_EQ(actual.size(), expected.size());
  double difference = 0, norm = 0;
  for (std::size_t i = 0; i < std::min(actual.size(), expected.size()); ++i) {
    difference += (double(actual[i]) - expected[i]) * (double(actual[i]) - expected[i]);
    norm += double(expected[i]) * expected[i];
  }
  if (!std::isfinite(difference)) return std::numeric_limits<double>::infinity();
  return norm > 0 ? std::sqrt(difference / norm) : std::sqrt(difference);
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
