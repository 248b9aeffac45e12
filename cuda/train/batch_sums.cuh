// SPDX-License-Identifier: Apache-2.0
// What the photos of a batch add up to before the update.
#pragma once

#include "cuda/device/warp.cuh"
#include "gs_train/training_model.h"

namespace gs::cuda {

/// All zero between batches.
struct BatchSums {
  Gaussians gradients;
  DensityStatistics statistics;
  Buffer<std::uint32_t> touched;  // (rows / 32)  a bit for each row: 1 if it has gradients
  explicit BatchSums(Memory& memory) : gradients(memory), statistics(memory), touched(memory) {}

  /// Has room for the rows of a model. Where rows were added or removed, or others are learned, the
  /// sums are made anew.
  void reserve(const TrainingModel& model) {
    const std::size_t count = model.count(), marks = (count + kWarp - 1) / kWarp;
    const bool has_sums = model.statistics.has_sums;
    // `touched` has its rows if all others have theirs.
    if (touched.size() == marks && gradients.count() == count &&
        gradients.has_time == model.gaussians.has_time && statistics.has_sums == has_sums)
      return;
    touched.resize_discard(0);
    take_learned_arrays(gradients, model.gaussians);
    statistics.has_sums = has_sums;
    gradients.resize(count);
    for_each_statistic([&](const char*, auto& array) { array.resize_discard(count); }, statistics);
    touched.resize_discard(marks);
    clear();
  }
  void clear() {
    gradients.fill_zero();
    for_each_statistic([](const char*, auto& array) { array.fill_zero(); }, statistics);
    touched.fill_zero();
  }
};

}  // namespace gs::cuda
