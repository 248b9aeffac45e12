// SPDX-License-Identifier: Apache-2.0
// The steps of the ranks of this process: all ranks of a run, or one of them, whose others are
// processes.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "cuda/ranks/photo_exchange.cuh"
#include "cuda/ranks/rank.cuh"
#include "cuda/train/pending_steps.h"
#include "cuda/train/photometric_stage.cuh"
#include "gs_train/ranks/step_order.h"

namespace gs::cuda {

struct RankedStep : PendingStep {
  using PendingStep::PendingStep;
  PhotometricUpdate photometric;
};

class RankSteps final : private StepLauncher<RankedStep> {
 public:
  /// A rank on each of these GPUs: all ranks of a run.
  explicit RankSteps(const std::vector<int>& devices);
  /// Rank `rank` of `count` that are processes. use_link() comes before deal().
  RankSteps(int device, int rank, int count);
  ~RankSteps() override;

  int count() const { return count_; }
  /// Of the first rank of this process.
  int device() const { return ranks_.front()->context.device(); }
  Context& context() { return ranks_.front()->context; }
  RankMemory& memory() { return ranks_.front()->memory; }
  /// The shard of that rank.
  TrainingModel& shard() { return ranks_.front()->shard; }

  /// How the rank reaches the others. `keep_watch`, which may throw, is called while it waits; it
  /// looks after the link, too.
  void use_link(DeviceLink& link, std::function<void()> keep_watch);
  /// Null: none. Throws UsageError as PhotometricStage::use() does.
  void use_photometric(const PhotometricModel* photometric, const std::string& device);
  void upload_views(const std::vector<View>& views, std::size_t photo_bytes);
  bool is_resident(const View& view) const { return ranks_.front()->photos.is_resident(view); }

  /// Deals the model, which lies on the first GPU. Steps train its shards from now on.
  void deal(const TrainingModel& model, const Deal& deal);
  /// The same where rank 0, another process, has the model. `shape` has its arrays without rows,
  /// and what a shard is besides.
  void take_deal(const TrainingModel& shape, const Deal& deal);
  /// Puts the rows of all shards back into the model.
  void gather(const TrainingModel& model);
  /// The same where rank 0 has the model.
  void give_rows();

  /// Launches a step. `model` counts its updates, and has the numbers of the photometric model: the
  /// run's model, or the shard of a rank that has none.
  void launch(TrainingModel& model, const StepOrder& order);
  /// Waits until all steps have changed the shards.
  void finish() { steps_.finish(); }
  bool is_finished() const { return steps_.empty(); }
  /// Whether the GPUs have nothing to do.
  bool is_idle() const { return streams_.are_idle(); }

  /// The rank that drew the last photo of the last step.
  int last_drawer() const { return last_drawer_; }
  /// Its loss, if it is one of this process.
  Loss& loss_of_last() { return *own(last_drawer_)->loss; }
  void release_caches(bool shards_are_in_use);

 private:
  // One photo of a step, and the rank that draws it.
  struct DrawnPhoto {
    const TrainingPhoto& photo;
    std::size_t index;  // in the batch
    std::uint32_t number;
    Camera camera;
    RenderSettings settings;
    int drawer;
    PhotoRoom& room;
    Rank* rank;  // null: another process draws it
  };

  void enqueue(const RankedStep& step) override;
  void run(const RankedStep& step);
  void update(const RankedStep& step, Rank& rank, Span<const PhotoRows> photos);
  DrawnPhoto drawn_photo(const RankedStep& step, std::size_t index);
  void wait_for_others(const Rank& rank) const;
  void draw(const RankedStep& step, const DrawnPhoto& drawn);
  void update_looks(const RankedStep& step);
  std::vector<PhotoUnderWay> under_way(const RankedStep& step, const std::vector<DrawnPhoto>& drawn,
                                       const std::vector<PhotoRows>& rows);

  void wait_for_launches() override { streams_.synchronize(); }
  void clear_failed_step() override;
  void clear_halted_steps() override;
  void keep_watch() override;

  // Null where it is another process.
  Rank* own(int rank) const {
    if (!exchange_) return ranks_[std::size_t(rank)].get();
    return rank == first_ ? ranks_.front().get() : nullptr;
  }

  RankStreams streams_;
  const int first_, count_;  // the first rank of this process; the ranks of the run
  std::vector<std::unique_ptr<Rank>> ranks_;  // of this process
  // Where photos of ranks that are other processes are projected to.
  std::vector<std::unique_ptr<PhotoRoom>> rooms_of_others_;
  std::vector<PhotoRoom*> rooms_;            // of all ranks
  std::unique_ptr<PhotoExchange> exchange_;  // null: there are no other processes
  DeviceLink* link_ = nullptr;               // the same
  std::function<void()> watch_;
  std::chrono::steady_clock::time_point last_watch_{};
  Deal deal_;
  std::unique_ptr<PhotometricStage> photometric_;  // of the first GPU
  PendingSteps<RankedStep> steps_;
  TrainingModel* model_ = nullptr;
  int last_drawer_ = 0;
};

}  // namespace gs::cuda
