// SPDX-License-Identifier: Apache-2.0
// The step of one rank: Backend::step() on its own rows, with photos that ranks differentiate
// together.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "gs_train/ranks/communicator.h"
#include "gs_train/ranks/deal.h"
#include "gs_train/ranks/splat_messages.h"
#include "gs_train/stages/scalar_backend.h"

namespace gs {

/// Where a rank stands in a step.
struct RankStep {
  Communicator* ranks = nullptr;
  Deal deal;
  Span<const TrainingPhoto> batch;
};

/// Photo i of a batch is drawn by rank i mod ranks, so a round of as many photos as ranks goes on
/// at the same time. Every sum has the order that one rank would give it.
class RankBackend final : public ScalarBackend {
 public:
  RankBackend();
  ~RankBackend() override;
  using ScalarBackend::step;
  /// One step of this rank. Nothing has changed where it throws before all ranks have come to their
  /// update.
  void step(const RankStep& now, TrainingModel& shard, const LossSettings& loss_settings,
            const Update& update, const DensityStep& density);
  Optimizer& optimizer() override;
  void release_caches() override;

 protected:
  Span<const double> appearance_gradient() const override;
  CameraGradient<double> camera_gradient(const GaussiansSpan& gaussians, const Camera& camera,
                                         const RenderSettings& settings,
                                         const RenderPass& pass) override;
  void differentiate_photo(const TrainingModel& shard, const TrainingPhoto& photo,
                           const LossSettings& loss_settings, const DensityStep& density) override;

 private:
  void run_round(const TrainingModel& shard, std::size_t first, const LossSettings& loss_settings,
                 const DensityStep& density);
  std::vector<SentSplat> project(const TrainingModel& shard, const TrainingPhoto& photo,
                                 const DensityStep& density, std::vector<std::uint32_t>& visible);
  std::vector<Message> draw(const TrainingModel& shard, const TrainingPhoto& photo,
                            const std::vector<Message>& sent, const LossSettings& loss_settings,
                            const DensityStep& density);
  void pull_back(const TrainingModel& shard, const TrainingPhoto& photo,
                 const DensityStep& density);

  RankStep now_;
  std::unique_ptr<Optimizer> optimizer_;
  std::vector<std::vector<std::uint32_t>> visible_;  // of each photo of the round, local rows
  std::vector<Message> replies_;                     // the same
  // of each photo of the round, from the rank that drew it; empty without photometric.model
  std::vector<std::vector<double>> appearance_gradients_;
  std::size_t in_round_ = 0;  // the photo that was pulled back last
  RenderPass drawn_;          // the rank's photo of the round, of all ranks' rows
};

}  // namespace gs
