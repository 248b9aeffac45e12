// SPDX-License-Identifier: Apache-2.0
// Which rows of a model a GPU trains, where several GPUs share it.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>

#include "gs_core/error.h"
#include "gs_core/types.h"

namespace gs::cuda {

/// Rows of a chunk. A chunk of the Morton order is a small region of space, so each view finds
/// about the same number of its Gaussians on every GPU.
inline constexpr std::size_t kChunkRows = 4096;

/// The rows of one GPU, or, by default, all rows of the model. Chunk c of the model is on GPU
/// c mod gpus, which has its chunks one after another, in order; the last chunk of the model may be
/// short. The arrays of a shard have its own (local) rows. What stages 1 to 6 leave of a photo has
/// the rows of the whole model, because all GPUs project into the buffers of the one that draws it.
struct Shard {
  unsigned gpu = 0, gpus = 1;
  unsigned chunk_bits = 0;   // chunks have 2^chunk_bits rows
  std::size_t all_rows = 0;  // of the whole model; not used by default

  Shard() = default;
  /// Chunks must have 2^k rows, whole warps of them.
  Shard(int gpu_, int gpus_, std::size_t all_rows_, std::size_t chunk_rows = kChunkRows)
      : gpu(unsigned(gpu_)), gpus(unsigned(gpus_)),
        chunk_bits(unsigned(std::countr_zero(chunk_rows))), all_rows(all_rows_) {
    GS_CHECK(std::has_single_bit(chunk_rows) && chunk_rows >= 32);
  }

  /// The row of the whole model that is row `local` of the shard. A warp's 32 rows stay neighbors.
  GS_HD std::size_t row_of_all(std::size_t local) const {
    if (gpus == 1) return local;
    const std::size_t chunk = local >> chunk_bits;
    return local + ((chunk * (gpus - 1) + gpu) << chunk_bits);
  }
  /// Rows of the whole model, where the shard has `own`.
  std::size_t count_of_all(std::size_t own) const { return gpus == 1 ? own : all_rows; }
  std::size_t chunk_rows() const { return std::size_t(1) << chunk_bits; }
  /// Rows of the shard.
  std::size_t count() const {
    const std::size_t turn = chunk_rows() * gpus, before = chunk_rows() * gpu;
    const std::size_t left = all_rows % turn;
    return all_rows / turn * chunk_rows() + std::min(left - std::min(left, before), chunk_rows());
  }
};

}  // namespace gs::cuda
