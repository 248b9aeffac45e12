// SPDX-License-Identifier: Apache-2.0
// A model dealt out to GPUs, and merged again: chunks of rows, copied from GPU to GPU.
#include <algorithm>
#include <string>

#include "cuda/ranks/rank.cuh"
#include "gs_train/ranks/shards.h"

namespace gs::cuda {
namespace {

// Calls copy(whole, whole_step, own, own_step, bytes, chunks) for all rows of a rank: its rows in
// the whole model and in the shard, the bytes from one chunk to the next in each, and those of a
// chunk.
// Chunks are equally far from each other, so one call covers all but the last, short one.
template <class Whole, class Own, class Copy>
void for_chunks(const Deal& deal, int rank, Whole* whole, Own* shard, Copy&& copy) {
  const std::size_t count = deal.count_of(rank), full = count / deal.chunk_rows,
                    rest = count % deal.chunk_rows, bytes = deal.chunk_rows * sizeof(Own);
  if (full)
    copy(whole + std::size_t(rank) * deal.chunk_rows, std::size_t(deal.ranks) * bytes, shard, bytes,
         bytes, full);
  if (!rest) return;
  const std::size_t local = full * deal.chunk_rows, left = rest * sizeof(Own);
  copy(whole + deal.global_of(rank, local), left, shard + local, left, left, std::size_t(1));
}

void copy_rows(const Rank& rank, void* to, std::size_t to_step, const void* from,
               std::size_t from_step, std::size_t bytes, std::size_t chunks) {
  check(cudaMemcpy2DAsync(to, to_step, from, from_step, bytes, chunks, cudaMemcpyDefault,
                          rank.context.stream()),
        "copying rows between GPUs");
}

}  // namespace

void connect(const std::vector<int>& devices) {
  for (const int from : devices)
    for (const int to : devices) {
      if (from == to) continue;
      int is_possible = 0;
      check(cudaDeviceCanAccessPeer(&is_possible, from, to), "asking how GPUs are connected");
      if (!is_possible)
        throw UsageError("GPU " + std::to_string(from) + " cannot read the memory of GPU " +
                         std::to_string(to) +
                         ", which ranks on several GPUs need; choose others with "
                         "CUDA_VISIBLE_DEVICES, or train on one (train.ranks=1)");
      const OnDevice here(from);
      const cudaError_t error = cudaDeviceEnablePeerAccess(to, 0);
      if (error == cudaErrorPeerAccessAlreadyEnabled)
        cudaGetLastError();  // the next call starts clean
      else
        check(error, "connecting GPUs");
    }
}

void deal_out(const TrainingModel& model, const Deal& deal,
              std::vector<std::unique_ptr<Rank>>& ranks) {
  for (int r = 0; r < deal.ranks; ++r) {
    Rank& rank = *ranks[std::size_t(r)];
    const OnDevice here(rank.context.device());
    take_shape_of(model, deal.count_of(r), rank.shard);
    rank.place = Shard(deal, r, rank.halted());
  }
  for (int r = 0; r < deal.ranks; ++r) {
    Rank& rank = *ranks[std::size_t(r)];
    const OnDevice here(rank.context.device());
    for_each_row_array(
        [&](const RowArray&, auto& to, const auto& from) {
          for_chunks(deal, r, from.data(), to.data(),
                     [&](const auto* whole, std::size_t whole_step, auto* own, std::size_t own_step,
                         std::size_t bytes, std::size_t chunks) {
                       copy_rows(rank, own, own_step, whole, whole_step, bytes, chunks);
                     });
        },
        rank.shard, model);
  }
  for (const std::unique_ptr<Rank>& rank : ranks) rank->context.synchronize();
}

void merge(const std::vector<std::unique_ptr<Rank>>& ranks, const Deal& deal,
           TrainingModel& model) {
  for (int r = 0; r < deal.ranks; ++r) {
    Rank& rank = *ranks[std::size_t(r)];
    const OnDevice here(rank.context.device());
    for_each_row_array(
        [&](const RowArray&, auto& to, auto& from) {
          GS_CHECK(to.size() == deal.rows && from.size() == deal.count_of(r));
          for_chunks(deal, r, to.data(), from.data(),
                     [&](auto* whole, std::size_t whole_step, const auto* own, std::size_t own_step,
                         std::size_t bytes, std::size_t chunks) {
                       copy_rows(rank, whole, whole_step, own, own_step, bytes, chunks);
                     });
        },
        model, rank.shard);
  }
  for (const std::unique_ptr<Rank>& rank : ranks) rank->context.synchronize();
}

}  // namespace gs::cuda
