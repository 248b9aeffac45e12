// SPDX-License-Identifier: Apache-2.0
// What a run learns of its training photos on a GPU. Twin of gs_train/photo_table.cpp.
#pragma once

#include "cuda/device/context.cuh"
#include "gs_train/photo_table.h"

namespace gs::cuda {

/// The update of a table in one step; there is none while its numbers rest.
struct PhotoTableUpdate {
  bool is_due = false;
  AdamStep adam{};
  AdamRule rule = {};
};

/// The gradient of a table, and its update. No step waits for the numbers: later steps read what
/// earlier ones have learned.
class PhotoTableStage {
 public:
  /// `name` is that of the stage among the times of a step.
  PhotoTableStage(const char* name, Context& context, Memory& memory)
      : context_(context), name_(name), gradient_(memory) {}

  static PhotoTableUpdate update_of(const PhotoTable& table, float rate, const AdamRule& rule) {
    if (table.empty() || !(rate > 0)) return {};
    return {true, adam_step(table.adam_steps + rule.steps, rate), rule};
  }
  /// Before the photos of a step. Waits where the run is new.
  void begin(const PhotoTable& table);
  /// dL/d(values) of a row, zero between steps.
  double* gradient_of(const PhotoTable& table, std::size_t row) const {
    return gradient_.data() + table.begin_of(row);
  }
  /// 8 for tables: Adam for all rows by the gradients and the pulls, then the modes are taken out.
  /// Clears the gradient. Nothing is changed while `halted` is raised.
  void update(PhotoTable& table, const PhotoPulls& pulls, const PhotoTableUpdate& update,
              const std::uint32_t* halted);
  /// After steps that failed or were halted.
  void clear_gradient() { gradient_.fill_zero(); }

 protected:
  Context& context_;
  const char* const name_;

 private:
  Buffer<double> gradient_;  // (rows, numbers)
};

}  // namespace gs::cuda
