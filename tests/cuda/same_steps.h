// SPDX-License-Identifier: Apache-2.0
// Steps on the GPU that learn the same bits each time.
#pragma once

#include "tests/support/cuda.h"

namespace gs {

/// Takes 20 steps from `start`, four times, and expects the same bits. `step(model, k)` takes step k
/// on the GPU.
template <class Step>
void expect_same_bits_each_time(Backend& gpu, const TrainingModel& start, const Step& step) {
  constexpr std::size_t kSteps = 20;
  const auto after_steps = [&] {
    TrainingModel model = copy_to(gpu.memory(), start);
    for (std::size_t k = 0; k < kSteps; ++k) step(model, k);
    gpu.synchronize(model);
    return copy_to(host_memory(), model);
  };
  const TrainingModel first = after_steps();
  for (int again = 0; again < 3; ++again) EXPECT_TRUE(same_bits(after_steps(), first));
}

}  // namespace gs
