// SPDX-License-Identifier: Apache-2.0
#include "gs_train/ranks/ranked_backend.h"

#include <spdlog/fmt/fmt.h>

#include <utility>
#include <vector>

#include "gs_train/ranks/merged_rows.h"
#include "gs_train/stages/scalar_backend.h"

namespace gs {
namespace {

class RankedBackend final : public ScalarBackend {
 public:
  RankedBackend(std::unique_ptr<RankCrew> crew, std::size_t chunk_rows)
      : crew_(std::move(crew)), chunk_rows_(chunk_rows),
        rows_(*this, ScalarBackend::rows(),
              [this](RowOps& rows) { return crew_->count_not_finite(rows); }) {}
  std::string name() const override { return fmt::format("cpu ({} ranks)", crew_->count()); }
  RowOps& rows() override { return rows_; }
  Loss& loss() override { return crew_->loss(); }
  void use_loss(const std::string& kind) override {
    ScalarBackend::use_loss(kind);
    crew_->use_loss(kind);
  }
  void use_photometric(std::shared_ptr<const PhotometricModel> photometric) override {
    ScalarBackend::use_photometric(photometric);
    crew_->use_photometric(photometric);
  }
  void upload_views(const std::vector<View>& views, std::size_t) override {
    crew_->announce(views);
  }

  using Backend::step;
  void step(TrainingModel& model, Span<const TrainingPhoto> batch,
            const LossSettings& loss_settings, const Update& update,
            const DensityStep& density) override {
    // The statistics of the merged model have their sums from now on.
    if (density.fragment_statistic() != FragmentStatistic::none) begin_sums(model);
    if (!is_dealt(model)) deal(model);
    crew_->step({{batch.begin(), batch.end()}, loss_settings, update, density});
    // The cameras of the next step are made from them.
    if (!model.poses.empty()) take_learned(crew_->first_shard().poses, model.poses);
  }

  // On the merged model, as row operations.
  void score_photos(TrainingModel& model, Span<const TrainingPhoto> photos,
                    const PixelRule& rule) override {
    synchronize(model);
    ScalarBackend::score_photos(model, photos, rule);
  }

  void synchronize(TrainingModel& model) override {
    if (!is_dealt(model)) return;
    model.statistics.visits.resize(model.count());
    try {
      crew_->gather(model);
    } catch (...) {
      model.statistics.visits.resize(0);  // it is still with the ranks
      throw;
    }
    shards_are_in_use_ = false;
  }

  void release_caches() override {
    ScalarBackend::release_caches();
    crew_->release(shards_are_in_use_);
  }

 private:
  void deal(TrainingModel& model) {
    crew_->deal(model, {crew_->count(), model.count(), chunk_rows_});
    model.statistics.visits.resize(0);
    shards_are_in_use_ = true;
  }

  const std::unique_ptr<RankCrew> crew_;
  const std::size_t chunk_rows_;
  MergedRows rows_;
  bool shards_are_in_use_ = false;
};

}  // namespace

std::unique_ptr<Backend> make_ranked_backend(const RankOptions& options) {
  return make_ranked_backend(make_thread_crew(options.count, options.deadline), options.chunk_rows);
}

std::unique_ptr<Backend> make_ranked_backend(std::unique_ptr<RankCrew> crew,
                                             std::size_t chunk_rows) {
  return std::make_unique<RankedBackend>(std::move(crew), chunk_rows);
}

}  // namespace gs
