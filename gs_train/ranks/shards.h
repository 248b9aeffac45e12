// SPDX-License-Identifier: Apache-2.0
// A model dealt out to ranks, and merged again. Host memory only.
#pragma once

#include <vector>

#include "gs_train/ranks/deal.h"
#include "gs_train/training_model.h"

namespace gs {

/// Gives a shard `count` rows, which are undefined, in the arrays that the model has.
void take_shape_of(const TrainingModel& model, std::size_t count, TrainingModel& shard);

/// Gives each shard its rows of all arrays, and the counts that belong to the whole model. Throws
/// Error where memory runs out; the model does not change.
void deal_out(const TrainingModel& model, const Deal& deal, std::vector<TrainingModel>& shards);

/// Puts the rows of the shards back into the model, which has room for them.
void merge(const std::vector<TrainingModel>& shards, const Deal& deal, TrainingModel& model);

}  // namespace gs
