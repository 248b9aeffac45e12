// SPDX-License-Identifier: Apache-2.0
// Stage 9 under the MCMC strategy: dead rows become copies of live ones, and copies are added.
#pragma once

#include "cuda/device/context.cuh"
#include "gs_train/row_ops.h"

namespace gs::cuda {

/// RowOps::relocate() with its buffers. The draws are those of the scalar twin.
class Relocation {
 public:
  Relocation(Context& context, Memory& memory)
      : context_(context), sums_(memory), dead_(memory), source_(memory), drawn_(memory),
        dead_count_(1, memory), cub_(memory) {}

  /// Waits twice: to learn whether any row is alive, and how many are dead.
  RefineReport run(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                   int step);
  /// RowOps::replace().
  void replace(TrainingModel& model, Span<const std::uint32_t> dead,
               Span<const std::uint32_t> source, float least_opacity);

 private:
  template <class... Parameters, class... Arguments>
  void launch(void (*kernel)(Parameters...), std::size_t count, Arguments&&... arguments);
  std::uint64_t sum_weights(const TrainingModel& model, const RelocationRules& rules);
  std::size_t find_dead();
  void draw(std::size_t count, const Random& random, int step);
  void share_sources(TrainingModel& model, float least_opacity);
  void set_rows(TrainingModel& model, RowRole role, const std::uint32_t* to, std::size_t first);
  void copy_rows(TrainingModel& model, const std::uint32_t* to, std::size_t first);
  std::size_t move_dead_rows(TrainingModel& model, const RelocationRules& rules,
                             const Random& random, int step);
  std::size_t add_copies(TrainingModel& model, const RelocationRules& rules, const Random& random,
                         int step);

  Context& context_;
  Buffer<std::uint64_t> sums_;        // (N) inclusive prefix sums of the weights
  Buffer<std::uint32_t> dead_;        // row numbers
  Buffer<std::uint32_t> source_;      // the row that each copy is made from
  Buffer<std::uint32_t> drawn_;       // (N) how often each row was drawn
  Buffer<std::uint32_t> dead_count_;  // (1)
  Buffer<std::uint8_t> cub_;
};

}  // namespace gs::cuda
