// SPDX-License-Identifier: Apache-2.0
// The scalar CPU backend as a class, for tests that count its calls.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "gs_train/backend.h"

namespace gs {

struct ScalarLoss;  // a row of the table of losses, in scalar_backend.cpp

class ScalarBackend : public Backend {
 public:
  ScalarBackend();
  std::string name() const override { return "cpu"; }
  Memory& memory() override { return host_memory(); }
  Renderer& renderer() override { return *renderer_; }
  void use_loss(const std::string& kind) override;
  Loss& loss() override { return *loss_; }
  void use_photometric(std::shared_ptr<const PhotometricModel> photometric) override;
  Optimizer& optimizer() override { return *optimizer_; }
  RowOps& rows() override { return *rows_; }
  void set_profiling(bool on) override;
  std::vector<StageTime> stage_times() override;

 protected:
  void add_pixel_scores(const View& view, const RenderSettings& settings, const PixelRule& rule,
                        RenderPass& pass, Span<FragmentSums> to) override;
  void compare_depth(const View& view, const RenderSettings& settings, float weight,
                     RenderPass& pass) override;
  void gather(const DensityStatistics& statistics, const RenderPass& pass,
              Span<const Vec2f> dL_dmean2d) override;
  using Backend::add;
  void add(Span<float> to, Span<const float> from, float weight) override;
  CameraGradient<double> camera_gradient(const GaussiansSpan& gaussians, const Camera& camera,
                                         const RenderSettings& settings,
                                         const RenderPass& pass) override;
  void update_photometric(PhotometricState& state, const Update& update,
                          std::vector<double>& gradient) override;
  void add(Span<FragmentSums> to, Span<FragmentSums> from) override;

 private:
  std::unique_ptr<Renderer> renderer_;
  const ScalarLoss* loss_row_;
  std::unique_ptr<Loss> loss_;
  std::unique_ptr<Optimizer> optimizer_;
  std::unique_ptr<RowOps> rows_;
  Buffer<float> pixel_values_;  // (H, W)  of a score pass
};

}  // namespace gs
