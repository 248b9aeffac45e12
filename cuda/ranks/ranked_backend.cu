// SPDX-License-Identifier: Apache-2.0
// Several GPUs of one machine behind the contract of one backend. One thread launches on all of
// them. A photo of a round belongs to one rank, which draws it:
//
//   each rank     projects its rows for each photo of the round, into the buffers of the photo's
//                 rank
//   photo's rank  sorts, blends, compares, blends backward
//   each rank     pulls the gradients of its rows back, from the buffers of the photo's rank
//   each rank     after all rounds of a batch: updates its rows
//
// Most batches are done together (photo_rows.cuh): there are no rounds then.
//
// Kernels read and write the memory of other GPUs, so that nothing is packed, sent and unpacked.
// Splats lie in the order of the whole model, and every sum is that of one GPU: with
// RenderSettings::deterministic the model has the same bytes for any number of ranks.
#include <utility>

#include "cuda/backend.h"
#include "cuda/ranks/rank.cuh"
#include "cuda/train/pending_steps.h"
#include "cuda/train/photometric_stage.cuh"
#include "gs_train/ranks/merged_rows.h"

namespace gs::cuda {
namespace {

// A rank whose photo did not fit halts all.
__global__ void halt_kernel(std::uint32_t* mine, const std::uint32_t* of_photo) {
  if (*of_photo) *mine = 1;
}

struct Step : PendingStep {
  using PendingStep::PendingStep;
  PhotometricUpdate photometric;
};

class RankedCudaBackend final : private StepLauncher<Step>, public Backend {
 public:
  RankedCudaBackend(const std::vector<int>& devices, std::size_t chunk_rows)
      : RankedCudaBackend(make_backend(devices.front()), devices, chunk_rows) {}
  ~RankedCudaBackend() override {
    streams_.wait();
    streams_.forget();
  }

  void make_current() override { whole_->make_current(); }
  std::string name() const override {
    return whole_->name() + " and others (" + std::to_string(ranks_.size()) + " ranks)";
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
    return *ranks_[last_drawn_]->loss;
  }
  void use_photometric(std::shared_ptr<const PhotometricModel> photometric) override {
    finish_pending();
    whole_->use_photometric(photometric);  // which refuses what GPUs do not have
    photometric_->use(photometric.get(), name());
  }
  void check_refines_poses() const override { refuse("poses.refine"); }
  void check_takes_depth() const override { refuse("depth maps (loss.depth_weight)"); }
  bool has_updates_bound_by_memory() const override { return true; }

  void upload_views(const std::vector<View>& views, std::size_t photo_bytes) override {
    finish_pending();
    for (const std::unique_ptr<Rank>& rank : ranks_) {
      const OnDevice here(rank->context.device());
      rank->photos.upload_views(views, photo_bytes);
    }
    steps_.forecast().forget();
  }
  void prefetch_decode(const View& view) override {
    if (!ranks_.front()->photos.is_resident(view)) prefetch_photo(view);
  }

  using Backend::step;
  void step(TrainingModel& model, Span<const TrainingPhoto> batch,
            const LossSettings& loss_settings, const Update& update,
            const DensityStep& density) override {
    GS_CHECK(model.poses.empty() && !model.lazy.is_on);
    if (model_ != &model) finish_pending();
    model_ = &model;
    // The statistics of the merged model have their sums from now on.
    if (density.fragment_statistic() != FragmentStatistic::none) begin_sums(model);
    if (!is_dealt(model)) deal(model);
    Step step(model, batch, loss_settings, update, density);
    const PhotometricUpdate photometric = step.photometric =
        photometric_->update_of(model.photometric, update);
    steps_.launch(std::move(step), model.count());
    if (photometric.is_due) model.photometric.adam_steps += photometric.rule.steps;
    model.adam_steps += update.rule.steps;
    last_drawn_ = (batch.size - 1) % ranks_.size();
  }

  void synchronize(TrainingModel& model) override {
    finish_pending();
    if (is_dealt(model)) {
      model.statistics.visits.resize(model.count());
      merge(ranks_, deal_, model);
      shards_are_in_use_ = false;
    }
    whole_->synchronize(model);
  }

  void release_caches() override {
    finish_pending();
    release_pass();
    for (const std::unique_ptr<Rank>& rank : ranks_) {
      const OnDevice here(rank->context.device());
      rank->release_caches();
      if (!shards_are_in_use_) rank->shard = TrainingModel(rank->memory);
    }
    photometric_->release_caches();
    whole_->release_caches();
  }

  void set_profiling(bool on) override {
    const OnDevice here(ranks_.front()->context.device());
    ranks_.front()->context.set_profiling(on);
  }
  std::vector<StageTime> stage_times() override { return ranks_.front()->context.stage_times(); }

 protected:
  // Parts of Backend::step(), which step() above overrides.
  void find_pixel_values(const View&, const DensityStep&, RenderPass&) override { GS_CHECK(false); }
  void gather(const DensityStatistics&, const RenderPass&, Span<const Vec2f>,
              ScorePooling) override {
    GS_CHECK(false);
  }
  void add(Span<float>, Span<const float>, float) override { GS_CHECK(false); }
  void pool(Span<FragmentSums>, Span<FragmentSums>, ScorePooling) override { GS_CHECK(false); }

 private:
  // One photo of a step, and the rank that draws it.
  struct DrawnPhoto {
    const TrainingPhoto& photo;
    std::uint32_t number;
    Camera camera;
    RenderSettings settings;
    Rank& rank;
  };

  RankedCudaBackend(std::unique_ptr<Backend> whole, const std::vector<int>& devices,
                    std::size_t chunk_rows)
      : Backend(whole->memory()), whole_(std::move(whole)), chunk_rows_(chunk_rows),
        rows_(*this, whole_->rows(), [this](RowOps& rows) {
          synchronize(*model_);
          return rows.count_not_finite(*model_);
        }) {
    connect(devices);
    for (const int device : devices) {
      const OnDevice here(device);
      ranks_.push_back(std::make_unique<Rank>(device, streams_));
    }
    make_current();
    photometric_ =
        std::make_unique<PhotometricStage>(ranks_.front()->context, ranks_.front()->memory);
  }

  [[noreturn]] static void refuse(const std::string& what) {
    throw UsageError("several GPUs do not take " + what +
                     " yet; train without, or on one GPU (train.ranks=1)");
  }

  void deal(TrainingModel& model) {
    whole_->synchronize(model);
    deal_ = {int(ranks_.size()), model.count(), chunk_rows_};
    deal_out(model, deal_, ranks_);
    model.statistics.visits.resize(0);
    shards_are_in_use_ = true;
  }

  // No rank begins an update before all memory for the step was found.
  void enqueue(const Step& step) override {
    const bool are_together = step.are_together(*model_);
    {
      const OnDevice here(ranks_.front()->context.device());
      photometric_->begin(model_->photometric, step.batch.size());
    }
    for (const std::unique_ptr<Rank>& rank : ranks_) {
      if (step.density.fragment_statistic() != FragmentStatistic::none) begin_sums(rank->shard);
      if (step.is_batch() && !are_together) rank->sums.reserve(rank->shard);
    }
    if (are_together)
      run_together(step);
    else
      for (std::size_t first = 0; first < step.batch.size(); first += ranks_.size())
        run_round(step, first);
    update_looks(step);
    for (const std::unique_ptr<Rank>& rank : ranks_) {
      const OnDevice here(rank->context.device());
      if (step.is_batch() && !are_together) update(step, *rank);
      if (step.density.noise.scale > 0)
        add_position_noise(rank->context, rank->shard.gaussians.span(), step.density.noise,
                           step.position_rate, rank->halted(), rank->place);
    }
  }

  // The numbers of the photometric model are on the first GPU, which knows by now that all photos
  // are drawn. Those that draw the next ones read them there.
  void update_looks(const Step& step) {
    Rank& first = *ranks_.front();
    const OnDevice here(first.context.device());
    photometric_->update(model_->photometric, step.photometric, step.photos(), first.halted());
    if (step.photometric.is_due) first.has_pulled_back.set();
  }

  // All photos of a step: the ranks project their rows for all of them, then each draws its photos,
  // and then they update their rows by all of them.
  void run_together(const Step& step) {
    std::vector<DrawnPhoto> batch;
    std::vector<PhotoRows> photos;
    for (std::size_t i = 0; i < step.batch.size(); ++i) {
      batch.push_back(drawn_photo(step, i, *ranks_[i % ranks_.size()]));
      const DrawnPhoto& drawn = batch.back();
      const OnDevice here(drawn.rank.context.device());
      steps_.reports().clear(drawn.number);
      photos.push_back(drawn.rank.photo_buffers.rows(i / ranks_.size(), drawn.camera,
                                                     drawn.settings, model_->count(),
                                                     drawn.rank.renderer, drawn.rank.pass));
      if (i < ranks_.size()) drawn.rank.photos.prefetch_next(*drawn.photo.view);
    }
    const Span<const PhotoRows> all{photos.data(), photos.size()};
    for (const std::unique_ptr<Rank>& rank : ranks_) {
      const OnDevice here(rank->context.device());
      wait_for_others(*rank);
      preprocess_batch(rank->context, rank->shard.gaussians.span(), all, rank->place);
      rank->has_projected.set();
    }
    for (std::size_t i = 0; i < batch.size(); ++i) {
      Rank& rank = batch[i].rank;
      const OnDevice here(rank.context.device());
      if (i + ranks_.size() < batch.size())
        rank.photos.prefetch_next(*batch[i + ranks_.size()].photo.view);
      rank.photo_buffers.select(i / ranks_.size(), batch[i].camera, model_->count(), rank.renderer,
                                rank.pass);
      draw(step, batch[i]);
    }
    for (const std::unique_ptr<Rank>& rank : ranks_) {
      const OnDevice here(rank->context.device());
      for (const std::unique_ptr<Rank>& other : ranks_) {
        other->has_drawn.hold_back(rank->context);
        if (other != rank) halt_by(*rank, *other);
      }
      update_by_photos(rank->context, rank->shard, all, step.adam, step.rule, step.rounding,
                       step.density, rank->halted(), rank->place);
      rank->has_pulled_back.set();
    }
  }

  // As many photos as there are ranks, from photo `first` of the step on.
  void run_round(const Step& step, std::size_t first) {
    std::vector<DrawnPhoto> round;
    for (std::size_t k = 0; k < ranks_.size() && first + k < step.batch.size(); ++k)
      round.push_back(drawn_photo(step, first + k, *ranks_[k]));
    for (const DrawnPhoto& drawn : round) {
      const OnDevice here(drawn.rank.context.device());
      steps_.reports().clear(drawn.number);
      drawn.rank.renderer.reserve_gradients(model_->count(), drawn.settings);
      drawn.rank.photos.prefetch_next(*drawn.photo.view);
    }
    for (const std::unique_ptr<Rank>& rank : ranks_) project(*rank, round);
    for (const DrawnPhoto& drawn : round) draw(step, drawn);
    for (const std::unique_ptr<Rank>& rank : ranks_) pull_back(step, *rank, round);
  }

  DrawnPhoto drawn_photo(const Step& step, std::size_t index, Rank& rank) const {
    const TrainingPhoto& photo = step.batch[index];
    RenderSettings settings = photo.settings;
    settings.fragment_statistic = step.density.fragment_statistic();
    settings.with_depths = false;
    return {photo, step.number_of(index), reduced(photo.camera(), photo.reduction), settings, rank};
  }

  // A rank's rows for each photo of a round, once all ranks are done with the photos before.
  void project(Rank& rank, const std::vector<DrawnPhoto>& round) {
    const OnDevice here(rank.context.device());
    wait_for_others(rank);
    for (const DrawnPhoto& drawn : round)
      preprocess(rank.context, rank.shard.gaussians.span(), drawn.camera, drawn.settings,
                 drawn.rank.renderer.workspace(), drawn.rank.pass, nullptr, rank.place);
    rank.has_projected.set();
  }

  // What a rank launches from now on comes after all that was launched on the others.
  void wait_for_others(const Rank& rank) const {
    for (const std::unique_ptr<Rank>& other : ranks_) {
      other->has_drawn.hold_back(rank.context);
      other->has_pulled_back.hold_back(rank.context);
    }
  }

  // A photo, by its rank, once all ranks have projected their rows.
  void draw(const Step& step, const DrawnPhoto& drawn) {
    Rank& rank = drawn.rank;
    const OnDevice here(rank.context.device());
    for (const std::unique_ptr<Rank>& other : ranks_) other->has_projected.hold_back(rank.context);
    rank.renderer.finish_projected(drawn.settings, rank.pass,
                                   steps_.forecast().capacity_for(drawn.photo, model_->count()),
                                   steps_.reports().of_step(drawn.number), drawn.number);
    LossSettings loss_settings = step.loss_settings;
    loss_settings.photo_reduction = drawn.photo.reduction;
    std::optional<PhotoOnDevice> on_device;
    if (photometric_->is_on()) {
      on_device =
          photometric_->photo(model_->photometric, step.photometric, drawn.photo, drawn.camera,
                              drawn.number - step.first_photo, step.batch.size());
      loss_settings.photo_on_device = &*on_device;
    }
    rank.loss->forward_backward(rank.pass, *drawn.photo.view, loss_settings, rank.dL_dimage);
    if (drawn.settings.fragment_statistic == FragmentStatistic::values)
      gs::cuda::find_pixel_values(rank.context, rank.photos.last(), *drawn.photo.view,
                                  loss_settings.photo_on_device, step.density,
                                  rank.renderer.workspace(), rank.pass);
    blend_backward(rank.context, drawn.settings, rank.dL_dimage.span(), rank.renderer.workspace(),
                   rank.pass);
    rank.has_drawn.set();
  }

  static void halt_by(Rank& rank, Rank& other) {
    rank.context.launch("halt", halt_kernel, 1, 1, rank.renderer.workspace().halted.data(),
                        other.halted());
  }

  // The gradients of a rank's rows, photo after photo. Where a photo did not fit, nothing changes.
  void pull_back(const Step& step, Rank& rank, const std::vector<DrawnPhoto>& round) {
    const OnDevice here(rank.context.device());
    for (const DrawnPhoto& drawn : round) {
      Workspace& workspace = drawn.rank.renderer.workspace();
      drawn.rank.has_drawn.hold_back(rank.context);
      if (&drawn.rank != &rank) halt_by(rank, drawn.rank);
      if (drawn.settings.fragment_statistic != FragmentStatistic::none)
        gather_fragment_sums(
            rank.context, drawn.settings, workspace, drawn.rank.pass, step.density.pooling,
            step.is_batch() ? rank.sums.statistics : rank.shard.statistics, rank.place);
      if (step.is_batch())
        preprocess_backward_and_add(rank.context, rank.shard.gaussians.span(), drawn.camera,
                                    drawn.settings, step.density, workspace, drawn.rank.pass,
                                    1.0f / float(step.batch.size()), rank.sums, nullptr,
                                    rank.place);
      else
        preprocess_backward_and_update(rank.context, rank.shard, drawn.camera, drawn.settings,
                                       step.adam, step.rule, step.rounding, step.density, workspace,
                                       drawn.rank.pass, nullptr, rank.place);
    }
    rank.has_pulled_back.set();
  }

  void update(const Step& step, Rank& rank) {
    const Regularizers& regularizers = step.density.regularizers;
    if (regularizers.any())
      add_regularizer_gradients(rank.context, rank.shard.gaussians.span(), regularizers,
                                rank.sums.gradients.span(), rank.place);
    update_by_sums(rank.context, rank.shard, step.adam, step.rule, step.rounding,
                   step.batch.back().settings.sh_degree, regularizers.any(), nullptr, rank.halted(),
                   rank.sums, rank.place);
    if (rank.shard.statistics.has_sums)
      pool_fragment_sums(rank.context, rank.shard.statistics.sums.span(),
                         rank.sums.statistics.sums.span(), step.density.pooling, rank.halted());
  }

  void wait_for_launches() override { streams_.synchronize(); }
  void clear_failed_step() override {
    for (const std::unique_ptr<Rank>& rank : ranks_) {
      rank->renderer.clear_gradients();
      rank->photo_buffers.clear_gradients();
    }
    clear_sums();
  }
  void clear_halted_steps() override {
    for (const std::unique_ptr<Rank>& rank : ranks_) rank->renderer.workspace().halted.fill_zero();
    clear_sums();
    streams_.synchronize();  // before one rank sees the flag of another
  }
  void clear_sums() {
    for (const std::unique_ptr<Rank>& rank : ranks_) rank->sums.clear();
    photometric_->clear_gradients();
  }

  void finish_pending() { steps_.finish(); }

  const std::unique_ptr<Backend> whole_;  // for all but steps: the backend of the first GPU
  const std::size_t chunk_rows_;
  RankStreams streams_;
  std::vector<std::unique_ptr<Rank>> ranks_;
  Deal deal_;
  bool shards_are_in_use_ = false;
  MergedRows rows_;
  std::unique_ptr<PhotometricStage> photometric_;  // of the first GPU
  PendingSteps<Step> steps_{*this};
  TrainingModel* model_ = nullptr;
  std::size_t last_drawn_ = 0;  // the rank that drew the last photo of the last step
};

}  // namespace

std::unique_ptr<Backend> make_ranked_backend(const std::vector<int>& devices,
                                             std::size_t chunk_rows) {
  GS_CHECK(!devices.empty());
  return std::make_unique<RankedCudaBackend>(devices, chunk_rows);
}

}  // namespace gs::cuda
