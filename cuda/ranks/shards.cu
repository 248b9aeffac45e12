// SPDX-License-Identifier: Apache-2.0
// A model dealt out to GPUs, and merged again: chunks of rows, copied from GPU to GPU, or sent
// where ranks are processes.
#include <algorithm>
#include <string>

#include "cuda/ranks/chunk_copies.cuh"
#include "cuda/ranks/rank.cuh"
#include "gs_train/ranks/shards.h"

namespace gs::cuda {
namespace {

// Rows of a large model go in pieces, for which there is room: of about so many bytes for a rank.
constexpr std::size_t kPieceBytes = std::size_t(16) << 20;

template <class Array>
constexpr std::size_t row_bytes_of(const Array& array) {
  return sizeof(*array.data());
}
template <class Array>
std::byte* bytes_of(const Array& array) {
  return reinterpret_cast<std::byte*>(array.data());
}

enum class Way { to_ranks, to_whole };

// Moves an array between rank 0, which has the whole one, and the ranks. `own` has the rows of this
// rank; `whole` is null where this is not rank 0.
void move_array(Way way, const Rank& rank, const Deal& deal, int number, std::size_t row_bytes,
                std::byte* own, std::byte* whole, DeviceLink& link, Buffer<std::byte>& room) {
  const std::size_t piece =
      std::max(kPieceBytes / (row_bytes * deal.chunk_rows), std::size_t(1)) * deal.chunk_rows;
  const std::size_t slot = piece * row_bytes;
  if (whole) room.resize_discard(slot * std::size_t(deal.ranks - 1));
  // Rank 0 has as many rows as any other, so all ranks count the same pieces.
  for (std::size_t first = 0; first < deal.count_of(0); first += piece) {
    const auto end_of = [&](int r) { return std::min(first + piece, deal.count_of(r)); };
    std::vector<DevicePiece> pieces;
    if (!whole && first < end_of(number))
      pieces.push_back({0, own + first * row_bytes, (end_of(number) - first) * row_bytes});
    const auto for_others = [&](auto&& f) {
      for (int r = 1; r < deal.ranks; ++r)
        if (first < end_of(r)) f(r, room.data() + slot * std::size_t(r - 1));
    };
    if (whole)
      for_others([&](int r, std::byte* at) {
        if (way == Way::to_ranks)
          copy_chunks_out(rank.context, deal, r, row_bytes, first, end_of(r), whole, at);
        pieces.push_back({r, at, (end_of(r) - first) * row_bytes});
      });
    const bool is_sent = whole ? way == Way::to_ranks : way == Way::to_whole;
    link.exchange(is_sent ? pieces : std::vector<DevicePiece>{},
                  is_sent ? std::vector<DevicePiece>{} : pieces, rank.context.stream());
    if (whole && way == Way::to_whole)
      for_others([&](int r, const std::byte* at) {
        copy_chunks_back(rank.context, deal, r, row_bytes, first, end_of(r), at, whole);
      });
  }
  if (!whole) return;
  if (way == Way::to_ranks)
    copy_chunks_out(rank.context, deal, 0, row_bytes, 0, deal.count_of(0), whole, own);
  else
    copy_chunks_back(rank.context, deal, 0, row_bytes, 0, deal.count_of(0), own, whole);
}

// All arrays of a shard. `model` is the whole one at rank 0, and null elsewhere.
void move_rows(Way way, Rank& rank, const Deal& deal, int number, const TrainingModel* model,
               DeviceLink& link) {
  const OnDevice here(rank.context.device());
  Buffer<std::byte> room(rank.memory);
  const auto move = [&](const auto& own, std::byte* whole) {
    GS_CHECK(own.size() == deal.count_of(number));
    move_array(way, rank, deal, number, row_bytes_of(own), bytes_of(own), whole, link, room);
  };
  if (model)
    for_each_row_array(
        [&](const RowArray&, const auto& own, const auto& whole) {
          GS_CHECK(whole.size() == deal.rows);
          move(own, bytes_of(whole));
        },
        rank.shard, *model);
  else
    for_each_row_array([&](const RowArray&, const auto& own) { move(own, nullptr); }, rank.shard);
  rank.context.synchronize();
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
    take_place(model, deal, r, rank);
  }
  for (int r = 0; r < deal.ranks; ++r) {
    Rank& rank = *ranks[std::size_t(r)];
    const OnDevice here(rank.context.device());
    for_each_row_array(
        [&](const RowArray&, const auto& to, const auto& from) {
          copy_chunks_out(rank.context, deal, r, row_bytes_of(to), 0, deal.count_of(r),
                          bytes_of(from), bytes_of(to));
        },
        rank.shard, model);
  }
  for (const std::unique_ptr<Rank>& rank : ranks) rank->context.synchronize();
}

void merge(const std::vector<std::unique_ptr<Rank>>& ranks, const Deal& deal,
           const TrainingModel& model) {
  for (int r = 0; r < deal.ranks; ++r) {
    Rank& rank = *ranks[std::size_t(r)];
    const OnDevice here(rank.context.device());
    for_each_row_array(
        [&](const RowArray&, const auto& to, const auto& from) {
          GS_CHECK(to.size() == deal.rows && from.size() == deal.count_of(r));
          copy_chunks_back(rank.context, deal, r, row_bytes_of(to), 0, deal.count_of(r),
                           bytes_of(from), bytes_of(to));
        },
        model, rank.shard);
  }
  for (const std::unique_ptr<Rank>& rank : ranks) rank->context.synchronize();
}

void take_place(const TrainingModel& model, const Deal& deal, int number, Rank& rank) {
  take_shape_of(model, deal.count_of(number), rank.shard);
  rank.place = Shard(deal, number);
}

void deal_to_processes(Rank& rank, const Deal& deal, int number, const TrainingModel* model,
                       DeviceLink& link) {
  move_rows(Way::to_ranks, rank, deal, number, model, link);
}

void gather_from_processes(Rank& rank, const Deal& deal, int number, const TrainingModel* model,
                           DeviceLink& link) {
  move_rows(Way::to_whole, rank, deal, number, model, link);
}

}  // namespace gs::cuda
