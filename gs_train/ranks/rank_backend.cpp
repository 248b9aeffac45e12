// SPDX-License-Identifier: Apache-2.0
#include "gs_train/ranks/rank_backend.h"

#include <algorithm>

#include "gs_core/math/area_filter.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stage_clock.h"
#include "gs_render/stages.h"
#include "gs_train/row_rules.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

// Stage 8 of a part of the rows: means are over the whole model, and draws are by its rows.
class RankOptimizer final : public Optimizer {
 public:
  explicit RankOptimizer(const RankStep& now) : now_(now) {}
  void regularize(const TrainingModel& shard, const Regularizers& regularizers,
                  Gaussians& gradients) override {
    const HostStage stage("regularizers");
    add_regularizer_gradients(shard.gaussians.span(), regularizers.of_each(now_.deal.rows),
                              gradients.span());
  }
  // Where memory has run out on another rank, no rank begins its update.
  void step(TrainingModel& shard, const Gaussians& gradients, const Update& update) override {
    now_.ranks->barrier();
    const HostStage stage("adam");
    update_by_adam(shard, gradients, update,
                   [&](std::size_t i) { return now_.deal.global_of(now_.ranks->rank(), i); });
  }
  void add_noise(TrainingModel& shard, const PositionNoise& noise, float position_rate) override {
    const HostStage stage("position noise");
    const GaussiansSpan rows = shard.gaussians.span();
    const int rank = now_.ranks->rank();
    parallel_for(shard.count(), 4096, [&](std::size_t i) {
      rows.mean[i] += position_noise(rows, i, noise, position_rate, now_.deal.global_of(rank, i));
    });
  }

 private:
  const RankStep& now_;
};

}  // namespace

RankBackend::RankBackend() : optimizer_(std::make_unique<RankOptimizer>(now_)) {}

RankBackend::~RankBackend() = default;

Optimizer& RankBackend::optimizer() { return *optimizer_; }

void RankBackend::release_caches() {
  ScalarBackend::release_caches();
  drawn_ = RenderPass(memory());
  visible_.clear();
  replies_.clear();
}

void RankBackend::step(const RankStep& now, TrainingModel& shard, const LossSettings& loss_settings,
                       const Update& update, const DensityStep& density) {
  now_ = now;
  ScalarBackend::step(shard, now.batch, loss_settings, update, density);
}

void RankBackend::differentiate_photo(const TrainingModel& shard, const TrainingPhoto& photo,
                                      const LossSettings& loss_settings,
                                      const DensityStep& density) {
  const std::size_t index = std::size_t(&photo - now_.batch.data);
  in_round_ = index % std::size_t(now_.ranks->count());
  if (in_round_ == 0) run_round(shard, index, loss_settings, density);
  now_.ranks->sign_of_life();
  pull_back(shard, photo, density);
}

// There: each rank projects its rows for every photo of the round, and sends the visible ones to
// the rank that draws it. Back: the gradients of these. The gradient of a photo's appearance goes
// to all ranks, which update the numbers of all photos alike.
void RankBackend::run_round(const TrainingModel& shard, std::size_t first,
                            const LossSettings& loss_settings, const DensityStep& density) {
  const std::size_t ranks = std::size_t(now_.ranks->count());
  const std::size_t photos = std::min(ranks, now_.batch.size - first);
  visible_.resize(ranks);
  std::vector<Message> splats(ranks), replies(ranks);
  for (std::size_t k = 0; k < photos; ++k) {
    now_.ranks->sign_of_life();
    splats[k] = message_of(project(shard, now_.batch[first + k], density, visible_[k]));
  }
  const std::vector<Message> sent = now_.ranks->exchange(std::move(splats));
  const std::size_t mine = std::size_t(now_.ranks->rank());
  if (mine < photos) replies = draw(shard, now_.batch[first + mine], sent, loss_settings, density);
  replies_ = now_.ranks->exchange(std::move(replies));
  if (!photometric_) return;
  std::vector<double> gradient;
  if (mine < photos)
    gradient.assign(appearance_->gradient().begin(), appearance_->gradient().end());
  appearance_gradients_.clear();
  for (const Message& message : now_.ranks->all_gather(message_of(gradient)))
    appearance_gradients_.push_back(rows_in<double>(message));
}

Span<const double> RankBackend::appearance_gradient() const {
  const std::vector<double>& gradient = appearance_gradients_[in_round_];
  return {gradient.data(), gradient.size()};
}

// Every rank has the visible Gaussians of all ranks, and so the sum of one rank.
CameraGradient<double> RankBackend::camera_gradient(const GaussiansSpan& gaussians,
                                                    const Camera& camera,
                                                    const RenderSettings& settings,
                                                    const RenderPass& pass) {
  std::vector<CameraGradientRow> rows = camera_gradient_rows(gaussians, camera, settings, pass);
  for (CameraGradientRow& of_row : rows)
    of_row.row = std::uint32_t(now_.deal.global_of(now_.ranks->rank(), of_row.row));
  return sum_of_rows(merge_rows(now_.ranks->all_gather(message_of(rows)), now_.deal));
}

std::vector<SentSplat> RankBackend::project(const TrainingModel& shard, const TrainingPhoto& photo,
                                            const DensityStep& density,
                                            std::vector<std::uint32_t>& visible) {
  preprocess(shard.gaussians.span(), reduced(photo.camera(), photo.reduction),
             settings_of(photo, density), pass_);
  return visible_splats(pass_, now_.deal, now_.ranks->rank(), visible);
}

std::vector<Message> RankBackend::draw(const TrainingModel& shard, const TrainingPhoto& photo,
                                       const std::vector<Message>& sent,
                                       const LossSettings& loss_settings,
                                       const DensityStep& density) {
  const std::shared_ptr<const View> view = loaded_view(photo);
  const RenderSettings settings = settings_of(photo, density);
  std::vector<std::vector<SentSplat>> splats;
  for (const Message& message : sent) splats.push_back(rows_in<SentSplat>(message));
  now_.ranks->sign_of_life();
  drawn_.background = settings.background;
  const std::vector<int> owners =
      merge_splats(splats, now_.deal, reduced(photo.camera(), photo.reduction), drawn_);
  create_instances(settings, drawn_);
  sort_by_tile(drawn_);
  now_.ranks->sign_of_life();
  blend(settings, drawn_);
  now_.ranks->sign_of_life();
  compare(shard, photo, *view, loss_settings, density, drawn_);
  now_.ranks->sign_of_life();
  blend_backward(settings, dL_dimage_.span(), drawn_);
  now_.ranks->sign_of_life();

  std::vector<std::vector<SplatReply>> replies(sent.size());
  for (std::size_t i = 0; i < owners.size(); ++i)
    replies[std::size_t(owners[i])].push_back(reply_of(drawn_, settings, i));
  std::vector<Message> messages;
  for (const std::vector<SplatReply>& of_rank : replies) messages.push_back(message_of(of_rank));
  return messages;
}

void RankBackend::pull_back(const TrainingModel& shard, const TrainingPhoto& photo,
                            const DensityStep& density) {
  const Camera camera = reduced(photo.camera(), photo.reduction);
  const RenderSettings settings = settings_of(photo, density);
  pass_.begin(camera, shard.count());
  take_replies(visible_[in_round_], rows_in<SplatReply>(replies_[in_round_]), settings, pass_);
  preprocess_backward(shard.gaussians.span(), camera, settings, pass_, gradients_.span(),
                      dL_dmean2d_.span());
}

}  // namespace gs
