// SPDX-License-Identifier: Apache-2.0
// The ranks of a run, wherever they are.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gs_train/backend.h"
#include "gs_train/ranks/deal.h"
#include "gs_train/ranks/step_order.h"

namespace gs {

/// What the backend of a run asks its ranks to do. After a failure that has changed some of them,
/// and after a rank that was lost, every call throws Error.
class RankCrew {
 public:
  virtual ~RankCrew() = default;
  virtual int count() const = 0;
  virtual void use_loss(const std::string& kind) = 0;
  virtual void use_photometric(const std::shared_ptr<const PhotometricModel>& photometric) = 0;
  /// The views that steps will name. They live until the next call.
  virtual void announce(const std::vector<View>& views) = 0;

  /// Gives every rank its shard.
  virtual void deal(const TrainingModel& model, const Deal& deal) = 0;
  /// One step. Throws Error that names the rank that failed.
  virtual void step(const StepOrder& order) = 0;
  /// The loss of the last photo of the last step.
  virtual Loss& loss() = 0;
  /// That of rank 0, for what all ranks have alike.
  virtual const TrainingModel& first_shard() const = 0;
  /// Puts the rows of all shards back into the model, which has room for them.
  virtual void gather(TrainingModel& model) = 0;
  /// As RowOps::count_not_finite(), over all shards.
  virtual std::size_t count_not_finite(RowOps& rows) = 0;
  /// Releases buffers, and, where no shard is the model any more, the shards.
  virtual void release(bool shards_are_in_use) = 0;
};

/// Ranks as threads of this process.
///
/// deadline   seconds without a sign of life after which a rank has hung
std::unique_ptr<RankCrew> make_thread_crew(int count, double deadline);

}  // namespace gs
