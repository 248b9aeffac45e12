// SPDX-License-Identifier: Apache-2.0
// The scalar CPU backend as a class, for tests that count its calls.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gs_render/stage_clock.h"
#include "gs_train/backend.h"
#include "gs_train/train_step.h"

namespace gs {

class ScalarBackend : public Backend, private Device {
 public:
  ScalarBackend();
  Device& device() override { return *this; }
  Renderer& renderer() override { return *on_.renderer; }
  Loss& loss() override { return *on_.loss; }
  RowOps& rows() override { return *rows_; }
  void use(const RunChoices& choices) override;
  using Backend::step;
  void step(TrainingModel& model, const TrainingStep& step) override {
    train_step(on_, model, step);
  }
  void score_photos(TrainingModel& model, Span<const TrainingPhoto> photos,
                    const PixelRule& rule) override;
  void synchronize(TrainingModel&) override {}
  void release_caches() override;

  std::string name() const override { return "cpu"; }
  Memory& memory() override { return host_memory(); }
  void set_profiling(bool on) override { host_stage_clock().set_on(on); }
  std::vector<StageTime> stage_times() override { return host_stage_clock().times(); }

 private:
  std::string loss_name_ = RunChoices{}.loss;
  StepStages on_;
  std::unique_ptr<RowOps> rows_;
  Buffer<float> pixel_values_;  // (H, W)  of a score pass
};

}  // namespace gs
