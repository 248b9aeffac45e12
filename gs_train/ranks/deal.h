// SPDX-License-Identifier: Apache-2.0
// Which rank holds which row: chunks of the global order are dealt in turn.
#pragma once

#include <algorithm>
#include <cstddef>

namespace gs {

/// Rows of a chunk. A chunk of the Morton order is a small region of space, so each view finds
/// about the same number of its Gaussians on every rank.
inline constexpr std::size_t kChunkRows = 4096;

/// Row g of the whole model lies in chunk c = g / chunk_rows, on rank c mod ranks. A rank holds its
/// chunks one after another, in order; the last chunk of the model may be short. With one rank,
/// local and global rows are the same.
struct Deal {
  int ranks = 1;
  std::size_t rows = 0;  // of the whole model
  std::size_t chunk_rows = kChunkRows;

  int rank_of(std::size_t row) const { return int(row / chunk_rows % std::size_t(ranks)); }
  std::size_t local_of(std::size_t row) const {
    return row / chunk_rows / std::size_t(ranks) * chunk_rows + row % chunk_rows;
  }
  std::size_t global_of(int rank, std::size_t local) const {
    return (local / chunk_rows * std::size_t(ranks) + std::size_t(rank)) * chunk_rows +
           local % chunk_rows;
  }
  /// Rows of a rank.
  std::size_t count_of(int rank) const {
    const std::size_t turn = chunk_rows * std::size_t(ranks);
    const std::size_t left = rows % turn, before = std::size_t(rank) * chunk_rows;
    return rows / turn * chunk_rows + std::min(left - std::min(left, before), chunk_rows);
  }
  std::size_t chunk_count() const { return (rows + chunk_rows - 1) / chunk_rows; }
};

}  // namespace gs
