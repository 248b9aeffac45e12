// SPDX-License-Identifier: Apache-2.0
// Several GPUs behind the contract of one backend: of this process, whose one thread launches on
// all of them (rank_steps.cuh), or of processes with a GPU each, of which this one is rank 0. The
// others then launch the same steps as they are told to (process_rank.cu).
#include <utility>

#include "cuda/backend.h"
#include "cuda/ranks/gpu_peers.h"
#include "cuda/ranks/rank_steps.cuh"
#include "gs_train/ranks/merged_rows.h"
#include "gs_train/ranks/shards.h"

namespace gs::cuda {
namespace {

class RankedCudaBackend final : public Backend {
 public:
  RankedCudaBackend(const std::vector<int>& devices, std::size_t chunk_rows)
      : RankedCudaBackend(make_backend(devices.front()), nullptr, chunk_rows) {
    steps_ = std::make_unique<RankSteps>(devices);
    make_current();
  }
  RankedCudaBackend(int device, std::unique_ptr<GpuPeers> peers, std::size_t chunk_rows)
      : RankedCudaBackend(make_backend(device), std::move(peers), chunk_rows) {
    steps_ = std::make_unique<RankSteps>(device, 0, peers_->count());
    make_current();
  }

  void make_current() override { whole_->make_current(); }
  std::string name() const override {
    return whole_->name() + " and others (" + std::to_string(steps_->count()) +
           (peers_ ? " processes)" : " ranks)");
  }
  Memory& memory() override { return whole_->memory(); }
  Renderer& renderer() override { return whole_->renderer(); }
  Optimizer& optimizer() override { return whole_->optimizer(); }
  RowOps& rows() override { return rows_; }
  void use_loss(const std::string& kind) override {
    finish_pending();
    whole_->use_loss(kind);  // which refuses those that GPUs do not have; there is one
  }
  Loss& loss() override {
    finish_pending();
    const int drawer = steps_->last_drawer();
    if (!peers_ || drawer == 0) return steps_->loss_of_last();
    together([&] { sent_loss_.set(peers_->loss_of(drawer)); });
    return sent_loss_;
  }
  void use_photometric(std::shared_ptr<const PhotometricModel> photometric) override {
    finish_pending();
    whole_->use_photometric(photometric);  // which refuses what GPUs do not have
    steps_->use_photometric(photometric.get(), name());
    photometric_name_ = photometric ? photometric->name() : kNoPhotometricModel;
    if (peers_ && peers_->is_connected()) together([&] { send_photometric(); });
  }
  void check_refines_poses() const override { refuse("poses.refine"); }
  void check_takes_depth() const override { refuse("depth maps (loss.depth_weight)"); }

  void upload_views(const std::vector<View>& views, std::size_t photo_bytes) override {
    finish_pending();
    views_ = &views;
    if (!peers_) return steps_->upload_views(views, photo_bytes);
    together([&] {
      if (!peers_->is_connected()) {
        DeviceLink& link = peers_->connect(steps_->device());
        steps_->use_link(link, [this] { peers_->keep_watch(); });
        send_photometric();
      }
      Packer packer;
      packer.value(std::uint64_t(photo_bytes));
      peers_->send_all(RankFrame::photos, packer.take());
      steps_->upload_views(views, photo_bytes);
      peers_->wait_long_for_answers();
    });
  }
  void prefetch_decode(const View& view) override {
    if (!steps_->is_resident(view)) prefetch_photo(view);
  }

  using Backend::step;
  void step(TrainingModel& model, Span<const TrainingPhoto> batch,
            const LossSettings& loss_settings, const Update& update,
            const DensityStep& density) override {
    GS_CHECK(model.poses.empty());
    if (model_ != &model) finish_pending();
    model_ = &model;
    // The statistics of the merged model have their sums from now on.
    if (density.fragment_statistic() != FragmentStatistic::none) begin_sums(model);
    GS_CHECK(!peers_ || views_);
    if (!is_dealt(model)) deal(model);
    const StepOrder order{{batch.begin(), batch.end()}, loss_settings, update, density};
    together([&] {
      if (peers_) peers_->send_all(RankFrame::step, message_of(order, *views_));
      steps_->launch(model, order);
    });
  }

  void synchronize(TrainingModel& model) override {
    finish_pending();
    if (is_dealt(model)) {
      model.statistics.visits.resize(model.count());
      together([&] {
        if (peers_) peers_->send_all(RankFrame::gather);
        steps_->gather(model);
      });
      shards_are_in_use_ = false;
    }
    whole_->synchronize(model);
  }

  // On the merged model, by the first GPU.
  void score_photos(TrainingModel& model, Span<const TrainingPhoto> photos,
                    const PixelRule& rule) override {
    synchronize(model);
    whole_->score_photos(model, photos, rule);
  }

  void release_caches() override {
    finish_pending();
    release_pass();
    together([&] {
      if (peers_ && peers_->is_connected()) {
        Packer packer;
        packer.value(shards_are_in_use_);
        peers_->send_all(RankFrame::release, packer.take());
      }
      steps_->release_caches(shards_are_in_use_);
    });
    whole_->release_caches();
  }

  void set_profiling(bool on) override {
    const OnDevice here(steps_->device());
    steps_->context().set_profiling(on);
  }
  std::vector<StageTime> stage_times() override { return steps_->context().stage_times(); }

 protected:
  // Parts of Backend::step() and score_photos(), which are overridden above.
  void add_pixel_scores(const View&, const RenderSettings&, const PixelRule&, RenderPass&,
                        Span<FragmentSums>) override {
    GS_CHECK(false);
  }
  void gather(const DensityStatistics&, const RenderPass&, Span<const Vec2f>) override {
    GS_CHECK(false);
  }
  void add(Span<float>, Span<const float>, float) override { GS_CHECK(false); }
  void add(Span<FragmentSums>, Span<FragmentSums>) override { GS_CHECK(false); }

 private:
  RankedCudaBackend(std::unique_ptr<Backend> whole, std::unique_ptr<GpuPeers> peers,
                    std::size_t chunk_rows)
      : Backend(whole->memory()), whole_(std::move(whole)), chunk_rows_(chunk_rows),
        peers_(std::move(peers)), rows_(*this, whole_->rows(), [this](RowOps& rows) {
          synchronize(*model_);
          return rows.count_not_finite(*model_);
        }) {}

  [[noreturn]] static void refuse(const std::string& what) {
    throw UsageError("several GPUs do not take " + what +
                     " yet; train without, or on one GPU (train.ranks=1)");
  }

  // Calls f(), in which all ranks take part. Of processes, a failure names the rank.
  template <class F>
  void together(F&& f) {
    if (peers_)
      peers_->named(f);
    else
      f();
  }

  void deal(TrainingModel& model) {
    whole_->synchronize(model);
    const Deal deal{steps_->count(), model.count(), chunk_rows_};
    together([&] {
      if (peers_) peers_->send_all(RankFrame::deal, message_of(deal, shape_of(model)));
      steps_->deal(model, deal);
    });
    model.statistics.visits.resize(0);
    shards_are_in_use_ = true;
  }

  // A shard without rows.
  static TrainingModel shape_of(const TrainingModel& model) {
    TrainingModel shape;
    take_shape_of(model, 0, shape);
    shape.photometric = copy_to(host_memory(), model.photometric);
    return shape;
  }

  void send_photometric() {
    Packer packer;
    packer.text(photometric_name_);
    peers_->send_all(RankFrame::use, packer.take());
    peers_->wait_for_answers();
  }

  void finish_pending() {
    if (steps_->is_finished()) return;
    together([&] {
      if (peers_) peers_->send_all(RankFrame::finish);
      steps_->finish();
    });
  }

  const std::unique_ptr<Backend> whole_;  // for all but steps: the backend of the first GPU
  const std::size_t chunk_rows_;
  const std::unique_ptr<GpuPeers> peers_;  // null: all ranks are of this process
  std::unique_ptr<RankSteps> steps_;
  bool shards_are_in_use_ = false;
  MergedRows rows_;
  SentLoss sent_loss_;
  std::string photometric_name_ = kNoPhotometricModel;
  const std::vector<View>* views_ = nullptr;
  TrainingModel* model_ = nullptr;
};

}  // namespace

std::unique_ptr<Backend> make_ranked_backend(const std::vector<int>& devices,
                                             std::size_t chunk_rows) {
  GS_CHECK(!devices.empty());
  return std::make_unique<RankedCudaBackend>(devices, chunk_rows);
}

std::unique_ptr<Backend> make_process_backend(int device, std::vector<PeerSocket> peers,
                                              PeerRules rules, std::unique_ptr<DeviceLinks> links,
                                              std::size_t chunk_rows) {
  return std::make_unique<RankedCudaBackend>(
      device, std::make_unique<GpuPeers>(std::move(peers), std::move(rules), std::move(links)),
      chunk_rows);
}

}  // namespace gs::cuda
