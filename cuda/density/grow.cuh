// SPDX-License-Identifier: Apache-2.0
// Stage 9 of the methods that grow: which rows grow, what they become, and what is pruned.
#pragma once

#include "cuda/density/rows.cuh"
#include "gs_train/row_ops.h"
#include "gs_train/row_rules.h"

namespace gs::cuda {

/// Counts of rows, which the host reads back.
struct GrowthCounts {
  std::uint32_t survivors, clones, parents, children;
  std::uint32_t pruned;  // before the limit
};

/// RowOps::grow() without the gather, with its buffers. The rows are those of the scalar twin.
class Growth {
 public:
  Growth(Context& context, Memory& memory, RowOrderWorkspace& workspace)
      : context_(context), workspace_(workspace), action_(memory), child_action_(memory),
        clones_(memory), parents_(memory), children_(memory), counts_(1, memory) {}

  /// What a refinement makes of the model's rows.
  struct Result {
    RefineReport report;
    std::size_t survivors = 0, first_child = 0;
  };
  /// First either decides what becomes of each row, or takes what is given.
  void decide(const TrainingModel& model, const GrowthRules& rules, std::uint64_t seed, int step);
  void take(Span<const GrowthAction> actions);
  /// Lists in `source` the row that each new row comes from. Changes nothing of the model. Waits
  /// twice, where rows are split.
  Result choose(const TrainingModel& model, const GrowthRules& rules, std::uint64_t seed, int step,
                Buffer<std::uint32_t>& source);
  /// After the gather by `source`: turns the copies of parents into children, and changes the
  /// opacities of originals that stay.
  void finish(const GaussiansSpan& rows, const Result& result, const GrowthRules& rules,
              std::uint64_t seed, int step, const Buffer<std::uint32_t>& source);
  void release();

 private:
  template <class... Parameters, class... Arguments>
  void launch(void (*kernel)(Parameters...), std::size_t count, Arguments&&... arguments);
  template <class Predicate>
  void select(std::size_t count, const Predicate& predicate, Buffer<std::uint32_t>& chosen,
              std::uint32_t* found);
  void choose_children(const TrainingModel& model, const GrowthRules& rules, const Random& random,
                       int step, std::size_t parents);

  Context& context_;
  RowOrderWorkspace& workspace_;
  Buffer<GrowthAction> action_;             // (N)
  Buffer<GrowthAction> child_action_;       // keep or prune
  Buffer<std::uint32_t> clones_, parents_;  // row numbers
  Buffer<std::uint32_t> children_;          // numbers of those that are kept
  Buffer<GrowthCounts> counts_;             // (1)
};

}  // namespace gs::cuda
