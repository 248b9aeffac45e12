// SPDX-License-Identifier: Apache-2.0
// What the ranks of a run are told: a step, and their shards. Processes get it as messages.
#pragma once

#include <optional>
#include <vector>

#include "gs_core/processes/packing.h"
#include "gs_train/backend.h"
#include "gs_train/ranks/communicator.h"
#include "gs_train/ranks/deal.h"

namespace gs {

/// The arguments of Backend::step() besides the model.
struct StepOrder {
  std::vector<TrainingPhoto> photos;
  LossSettings loss;
  Update update;
  DensityStep density;
};

/// A step as a message. Photos are named by their places in `views`, which all ranks have alike.
Message message_of(const StepOrder& order, const std::vector<View>& views);
StepOrder step_order_in(const Message& message, const std::vector<View>& views);

/// A rank's rows, and what it has of the photos.
struct DealtShard {
  Deal deal;
  TrainingModel shard;
};
Message message_of(const Deal& deal, const TrainingModel& shard);
DealtShard dealt_shard_in(const Message& message);

/// The rows alone, for a shard that has room for them.
Message rows_of(const TrainingModel& shard);
void take_rows(const Message& message, TrainingModel& shard);

}  // namespace gs
