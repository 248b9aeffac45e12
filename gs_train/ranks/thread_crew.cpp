// SPDX-License-Identifier: Apache-2.0
// Ranks as threads, behind the interface of a crew.
#include "gs_core/error.h"
#include "gs_train/ranks/rank_backend.h"
#include "gs_train/ranks/rank_crew.h"
#include "gs_train/ranks/shards.h"
#include "gs_train/ranks/thread_ranks.h"

namespace gs {
namespace {

// What the threads of the ranks work on. A thread that hangs keeps it.
struct Ranks {
  std::vector<std::unique_ptr<RankBackend>> backends;
  std::vector<TrainingModel> shards;
  Deal deal;
};

class ThreadCrew final : public RankCrew {
 public:
  ThreadCrew(int count, double deadline) : threads_(count, ThreadRanks::Seconds(deadline)) {
    for (int rank = 0; rank < count; ++rank)
      ranks_->backends.push_back(std::make_unique<RankBackend>());
  }
  int count() const override { return threads_.count(); }
  void use_loss(const std::string& kind) override {
    for (const auto& rank : ranks_->backends) rank->use_loss(kind);
  }
  void use_photometric(const std::shared_ptr<const PhotometricModel>& photometric) override {
    for (const auto& rank : ranks_->backends) rank->use_photometric(photometric);
  }
  void announce(const std::vector<View>&) override {}

  void deal(const TrainingModel& model, const Deal& deal) override {
    ranks_->deal = deal;
    deal_out(model, deal, ranks_->shards);
  }

  void step(const StepOrder& order) override {
    check_has_all_ranks();
    const int steps_before = first_shard().adam_steps;
    try {
      threads_.run([order, ranks = ranks_](Communicator& communicator) {
        const std::size_t rank = std::size_t(communicator.rank());
        const RankStep now{&communicator, ranks->deal, {order.photos.data(), order.photos.size()}};
        ranks->backends[rank]->step(now, ranks->shards[rank], order.loss, order.update,
                                    order.density);
      });
    } catch (...) {
      note_failure(steps_before);
      throw;
    }
    last_drawer_ = (order.photos.size() - 1) % ranks_->backends.size();
  }

  Loss& loss() override { return ranks_->backends[last_drawer_]->loss(); }
  const TrainingModel& first_shard() const override { return ranks_->shards.front(); }

  void gather(TrainingModel& model) override {
    check_has_all_ranks();
    // In a step that failed, some ranks may not have come to it.
    if (model.statistics.has_sums)
      for (TrainingModel& shard : ranks_->shards) begin_sums(shard);
    merge(ranks_->shards, ranks_->deal, model);
  }

  std::size_t count_not_finite(RowOps& rows) override {
    std::size_t count = 0;
    for (const TrainingModel& shard : ranks_->shards) count += rows.count_not_finite(shard);
    return count;
  }

  void release(bool shards_are_in_use) override {
    if (threads_.has_lost_rank()) return;  // its thread may still use them
    for (const auto& rank : ranks_->backends) rank->release_caches();
    if (!shards_are_in_use) ranks_->shards.clear();
  }

 private:
  void note_failure(int steps_before) {
    if (!threads_.has_lost_rank())
      for (const TrainingModel& shard : ranks_->shards)
        if (shard.adam_steps != steps_before) shards_differ_ = true;
  }

  void check_has_all_ranks() const {
    if (threads_.has_lost_rank() || shards_differ_)
      throw Error(
          "a rank has failed, and the model of this run is lost; go on from its last checkpoint "
          "(--resume)");
  }

  const std::shared_ptr<Ranks> ranks_ = std::make_shared<Ranks>();
  ThreadRanks threads_;
  std::size_t last_drawer_ = 0;  // the rank that drew the last photo of the last batch
  bool shards_differ_ = false;
};

}  // namespace

std::unique_ptr<RankCrew> make_thread_crew(int count, double deadline) {
  return std::make_unique<ThreadCrew>(count, deadline);
}

}  // namespace gs
