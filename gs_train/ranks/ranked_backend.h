// SPDX-License-Identifier: Apache-2.0
// Several ranks behind the contract of one backend.
#pragma once

#include <memory>

#include "gs_train/backend.h"
#include "gs_train/ranks/deal.h"
#include "gs_train/ranks/rank_crew.h"

namespace gs {

struct RankOptions {
  int count = 1;
  double deadline = 30;  // seconds without a sign of life after which a rank has hung
  std::size_t chunk_rows = kChunkRows;  // of the deal
};

/// A CPU backend whose steps are taken by ranks, which are threads. A model that it has trained has
/// the same bytes for any number of ranks. From a step until the next synchronize() or row operation
/// the shards of the ranks are the model; the TrainingModel keeps its number of rows, and its
/// statistics have none.
///
/// Where a rank throws, step() throws Error that names it. Where memory ran out, nothing has
/// changed. After any other failure during the update, and after a rank that hung, no step follows:
/// every call that needs the shards throws Error.
std::unique_ptr<Backend> make_ranked_backend(const RankOptions& options);
/// The same with the ranks of a crew.
std::unique_ptr<Backend> make_ranked_backend(std::unique_ptr<RankCrew> crew,
                                             std::size_t chunk_rows = kChunkRows);

}  // namespace gs
