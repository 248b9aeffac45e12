// SPDX-License-Identifier: Apache-2.0
#include "gs_train/ranks/shards.h"

#include <algorithm>

#include "gs_core/error.h"

namespace gs {
namespace {

// Calls f(global row, local row, rows) for each chunk of a rank.
template <class F>
void for_each_chunk_of(const Deal& deal, int rank, F&& f) {
  for (std::size_t local = 0; local < deal.count_of(rank); local += deal.chunk_rows)
    f(deal.global_of(rank, local), local, std::min(deal.chunk_rows, deal.count_of(rank) - local));
}

}  // namespace

void take_shape_of(const TrainingModel& model, std::size_t count, TrainingModel& shard) {
  shard.store_moments_as(model.moment_storage());
  shard.set_learned_arrays(model.gaussians);
  shard.gaussians.has_filter = model.gaussians.has_filter;
  shard.statistics.has_sums = model.statistics.has_sums;
  shard.adam_steps = model.adam_steps;
  shard.first_count = model.first_count;
  for_each_row_array([count](const RowArray&, auto& array) { array.resize_discard(count); }, shard);
}

void deal_out(const TrainingModel& model, const Deal& deal, std::vector<TrainingModel>& shards) {
  shards.resize(std::size_t(deal.ranks));
  for (int rank = 0; rank < deal.ranks; ++rank) {
    TrainingModel& shard = shards[std::size_t(rank)];
    take_shape_of(model, deal.count_of(rank), shard);
    // What is learned of photos has a copy on every rank, and all of them change alike.
    shard.photometric = copy_to(host_memory(), model.photometric);
    shard.poses = model.poses;
    for_each_row_array(
        [&](const RowArray&, auto& to, const auto& from) {
          for_each_chunk_of(deal, rank, [&](std::size_t row, std::size_t local, std::size_t count) {
            std::copy_n(from.data() + row, count, to.data() + local);
          });
        },
        shard, model);
  }
}

void merge(const std::vector<TrainingModel>& shards, const Deal& deal, TrainingModel& model) {
  for (int rank = 0; rank < deal.ranks; ++rank)
    for_each_row_array(
        [&](const RowArray&, auto& to, const auto& from) {
          GS_CHECK(to.size() == deal.rows && from.size() == deal.count_of(rank));
          for_each_chunk_of(deal, rank, [&](std::size_t row, std::size_t local, std::size_t count) {
            std::copy_n(from.data() + local, count, to.data() + row);
          });
        },
        model, shards[std::size_t(rank)]);
  const TrainingModel& first = shards.front();
  for_each_photometric_array(
      [](const char*, auto& to, const auto& from) { to.upload(from.download()); },
      model.photometric, first.photometric);
  model.photometric.adam_steps = first.photometric.adam_steps;
  take_learned(first.poses, model.poses);
  model.adam_steps = first.adam_steps;
}

}  // namespace gs
