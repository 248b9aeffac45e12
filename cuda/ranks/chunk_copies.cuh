// SPDX-License-Identifier: Apache-2.0
// Copies between an array with the rows of the whole model, and one with those of a rank. Chunks
// are equally far from each other in both, so that one call covers all but the last, short one.
#pragma once

#include <algorithm>
#include <cstddef>

#include "cuda/device/context.cuh"
#include "gs_train/ranks/deal.h"

namespace gs::cuda {

/// Where the chunks of some rows of a rank lie, in bytes.
struct ChunkPlaces {
  std::size_t whole, whole_step;  // the first chunk in the whole array, and from one to the next
  std::size_t own;                // the first chunk in the rank's array, where they are neighbors
  std::size_t bytes, chunks;      // of a chunk, and how many
};

/// Calls f(ChunkPlaces) for rows first .. end - 1 of a rank, in its own count; `first` begins a
/// chunk.
template <class F>
void for_chunks(const Deal& deal, int rank, std::size_t row_bytes, std::size_t first,
                std::size_t end, F&& f) {
  const std::size_t full = (end - first) / deal.chunk_rows, rest = (end - first) % deal.chunk_rows,
                    bytes = deal.chunk_rows * row_bytes;
  if (full)
    f(ChunkPlaces{deal.global_of(rank, first) * row_bytes, std::size_t(deal.ranks) * bytes,
                  first * row_bytes, bytes, full});
  if (!rest) return;
  const std::size_t local = first + full * deal.chunk_rows, left = rest * row_bytes;
  f(ChunkPlaces{deal.global_of(rank, local) * row_bytes, left, local * row_bytes, left, 1});
}

/// Copies rows first .. end - 1 of a rank from the whole array to its own, whose row `first` lies
/// at `own`, or the other way round.
inline void copy_chunks_out(const Context& context, const Deal& deal, int rank,
                            std::size_t row_bytes, std::size_t first, std::size_t end,
                            const std::byte* whole, std::byte* own) {
  for_chunks(deal, rank, row_bytes, first, end, [&](const ChunkPlaces& at) {
    check(
        cudaMemcpy2DAsync(own + (at.own - first * row_bytes), at.bytes, whole + at.whole,
                          at.whole_step, at.bytes, at.chunks, cudaMemcpyDefault, context.stream()),
        "copying rows between ranks");
  });
}
inline void copy_chunks_back(const Context& context, const Deal& deal, int rank,
                             std::size_t row_bytes, std::size_t first, std::size_t end,
                             const std::byte* own, std::byte* whole) {
  for_chunks(deal, rank, row_bytes, first, end, [&](const ChunkPlaces& at) {
    check(cudaMemcpy2DAsync(whole + at.whole, at.whole_step, own + (at.own - first * row_bytes),
                            at.bytes, at.bytes, at.chunks, cudaMemcpyDefault, context.stream()),
          "copying rows between ranks");
  });
}
/// Sets the rows of a rank to zero in the whole array.
inline void clear_chunks(const Context& context, const Deal& deal, int rank, std::size_t row_bytes,
                         std::byte* whole) {
  for_chunks(deal, rank, row_bytes, 0, deal.count_of(rank), [&](const ChunkPlaces& at) {
    check(cudaMemset2DAsync(whole + at.whole, at.whole_step, 0, at.bytes, at.chunks,
                            context.stream()),
          "clearing rows of a rank");
  });
}

}  // namespace gs::cuda
