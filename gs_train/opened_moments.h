// SPDX-License-Identifier: Apache-2.0
// Adam's moments as floats, to be compared.
#pragma once

#include "gs_train/training_model.h"

namespace gs {

/// In host memory.
struct OpenedMoments {
  Gaussians first, second;
};

inline OpenedMoments opened(const TrainingModel& model) {
  OpenedMoments result{rows_like(model.gaussians, model.count(), host_memory()),
                       rows_like(model.gaussians, model.count(), host_memory())};
  std::visit(
      [&](const auto& moments) {
        for_each_array(
            [](const char*, auto& m, auto& v, const auto& array) {
              const auto rows = array.download();
              for (std::size_t i = 0; i < rows.size(); ++i)
                for (std::size_t k = 0; k < std::size(rows[i].number); ++k) {
                  const FloatMoments pair = opened(rows[i].number[k]);
                  numbers_of(m)[i * std::size(rows[i].number) + k] = pair.first;
                  numbers_of(v)[i * std::size(rows[i].number) + k] = pair.second;
                }
            },
            result.first, result.second, moments);
      },
      model.moments);
  return result;
}

}  // namespace gs
