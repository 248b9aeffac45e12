// SPDX-License-Identifier: Apache-2.0
#include "gs_train/ranks/ranked_backend.h"

#include <spdlog/fmt/fmt.h>

#include <vector>

#include "gs_core/error.h"
#include "gs_train/ranks/rank_backend.h"
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

// A model whose rows are with the ranks has no statistics of its own: so the model itself says
// where its rows are, also where another model lies at the same place.
bool is_dealt(const TrainingModel& model) {
  return model.statistics.visits.size() != model.count();
}

// Row operations on the merged model, which the next step deals out again.
class MergedRows final : public RowOps {
 public:
  MergedRows(Backend& backend, RowOps& rows, const Ranks& ranks)
      : backend_(backend), rows_(rows), ranks_(ranks) {}
  RefineReport refine(TrainingModel& model, const AdaptiveRules& rules, const Random& random,
                      int step) override {
    return merged(model).refine(model, rules, random, step);
  }
  RefineReport grow(TrainingModel& model, const GrowthRules& rules, std::uint64_t seed,
                    int step) override {
    return merged(model).grow(model, rules, seed, step);
  }
  RefineReport relocate(TrainingModel& model, const RelocationRules& rules, std::uint64_t seed,
                        int step) override {
    return merged(model).relocate(model, rules, seed, step);
  }
  std::size_t make_static(TrainingModel& model, double least_time_scale) override {
    return merged(model).make_static(model, least_time_scale);
  }
  void measure_filter(TrainingModel& model, const std::vector<Camera>& cameras,
                      float near_plane) override {
    merged(model).measure_filter(model, cameras, near_plane);
  }
  void lower_opacity(TrainingModel& model, const OpacityRule& rule) override {
    merged(model).lower_opacity(model, rule);
  }
  std::size_t prune(TrainingModel& model, float opacity) override {
    return merged(model).prune(model, opacity);
  }
  std::size_t prune_share(TrainingModel& model, PruneOrder order, double share) override {
    return merged(model).prune_share(model, order, share);
  }
  void sort_by_morton(TrainingModel& model) override { merged(model).sort_by_morton(model); }
  void catch_up(TrainingModel& model) override { merged(model).catch_up(model); }
  void show_current_sh(const TrainingModel& model) override { rows_.show_current_sh(model); }
  void release_caches() override { rows_.release_caches(); }
  std::size_t count_not_finite(const TrainingModel& model) override {
    if (!is_dealt(model)) return rows_.count_not_finite(model);
    std::size_t count = 0;
    for (const TrainingModel& shard : ranks_.shards) count += rows_.count_not_finite(shard);
    return count;
  }

 private:
  RowOps& merged(TrainingModel& model) {
    backend_.synchronize(model);
    return rows_;
  }
  Backend& backend_;
  RowOps& rows_;
  const Ranks& ranks_;
};

class RankedBackend final : public ScalarBackend {
 public:
  explicit RankedBackend(const RankOptions& options)
      : options_(options), threads_(options.count, ThreadRanks::Seconds(options.deadline)),
        rows_(*this, ScalarBackend::rows(), *ranks_) {
    for (int rank = 0; rank < options.count; ++rank)
      ranks_->backends.push_back(std::make_unique<RankBackend>());
  }
  std::string name() const override { return fmt::format("cpu ({} ranks)", options_.count); }
  RowOps& rows() override { return rows_; }
  Loss& loss() override { return ranks_->backends[last_drawer_]->loss(); }
  void use_loss(const std::string& kind) override {
    ScalarBackend::use_loss(kind);
    for (const auto& rank : ranks_->backends) rank->use_loss(kind);
  }
  void use_photometric(std::shared_ptr<const PhotometricModel> photometric) override {
    ScalarBackend::use_photometric(photometric);
    for (const auto& rank : ranks_->backends) rank->use_photometric(photometric);
  }
  bool can_update_lazily() const override { return false; }

  using Backend::step;
  void step(TrainingModel& model, Span<const TrainingPhoto> batch,
            const LossSettings& loss_settings, const Update& update,
            const DensityStep& density) override {
    check_has_all_ranks();
    // The statistics of the merged model have their sums from now on.
    if (density.fragment_statistic() != FragmentStatistic::none) begin_sums(model);
    if (!is_dealt(model)) deal(model);
    const std::vector<TrainingPhoto> photos(batch.begin(), batch.end());
    const int steps_before = ranks_->shards.front().adam_steps;
    try {
      threads_.run([=, ranks = ranks_](Communicator& communicator) {
        const std::size_t rank = std::size_t(communicator.rank());
        const RankStep now{&communicator, ranks->deal, {photos.data(), photos.size()}};
        ranks->backends[rank]->step(now, ranks->shards[rank], loss_settings, update, density);
      });
    } catch (...) {
      note_failure(steps_before);
      throw;
    }
    last_drawer_ = (batch.size - 1) % std::size_t(options_.count);
    // The cameras of the next step are made from them.
    if (!model.poses.empty()) take_learned(ranks_->shards.front().poses, model.poses);
  }

  void synchronize(TrainingModel& model) override {
    if (!is_dealt(model)) return;
    check_has_all_ranks();
    GS_CHECK(ranks_->deal.rows == model.count());
    // In a step that failed, some ranks may not have come to it.
    if (model.statistics.has_sums)
      for (TrainingModel& shard : ranks_->shards) begin_sums(shard);
    model.statistics.visits.resize(model.count());
    merge(ranks_->shards, ranks_->deal, model);
    shards_are_in_use_ = false;
  }

  void release_caches() override {
    ScalarBackend::release_caches();
    if (threads_.has_lost_rank()) return;  // its thread may still use them
    for (const auto& rank : ranks_->backends) rank->release_caches();
    if (!shards_are_in_use_) ranks_->shards.clear();
  }

 private:
  void deal(TrainingModel& model) {
    ranks_->deal = {options_.count, model.count(), options_.chunk_rows};
    deal_out(model, ranks_->deal, ranks_->shards);
    model.statistics.visits.resize(0);
    shards_are_in_use_ = true;
  }

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

  const RankOptions options_;
  const std::shared_ptr<Ranks> ranks_ = std::make_shared<Ranks>();
  ThreadRanks threads_;
  MergedRows rows_;
  std::size_t last_drawer_ = 0;  // the rank that drew the last photo of the last batch
  bool shards_are_in_use_ = false, shards_differ_ = false;
};

}  // namespace

std::unique_ptr<Backend> make_ranked_backend(const RankOptions& options) {
  return std::make_unique<RankedBackend>(options);
}

}  // namespace gs
