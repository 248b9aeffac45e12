// SPDX-License-Identifier: Apache-2.0
// Which rows of the whole model a launch works on.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>

#include "gs_core/error.h"
#include "gs_core/types.h"
#include "gs_train/ranks/deal.h"

namespace gs::cuda {

/// The rows of one rank, or, by default, all rows of the model. The parameters of a shard have its
/// own (local) rows. What stages 1 to 6 leave of a photo has the rows of the whole model, because
/// all ranks project into the buffers of the rank that draws it.
struct Shard {
  unsigned rank = 0, ranks = 1;
  unsigned chunk_bits = 0;   // chunks have 2^chunk_bits rows
  std::size_t all_rows = 0;  // of the whole model; not used by default

  Shard() = default;
  /// Chunks must have 2^k rows, whole warps of them.
  Shard(const Deal& deal, int rank_)
      : rank(unsigned(rank_)), ranks(unsigned(deal.ranks)),
        chunk_bits(unsigned(std::countr_zero(deal.chunk_rows))), all_rows(deal.rows) {
    GS_CHECK(std::has_single_bit(deal.chunk_rows) && deal.chunk_rows >= 32);
  }

  /// The row of the whole model that is row `local` of the shard. A warp's 32 rows stay neighbors.
  GS_HD std::size_t row_of_all(std::size_t local) const {
    if (ranks == 1) return local;
    const std::size_t chunk = local >> chunk_bits;
    return local + ((chunk * (ranks - 1) + rank) << chunk_bits);
  }
  /// Rows of the whole model, where the shard has `own`.
  std::size_t count_of_all(std::size_t own) const { return ranks == 1 ? own : all_rows; }
};

}  // namespace gs::cuda
