// SPDX-License-Identifier: Apache-2.0
// The scalar CPU backend: the contracts in their simplest form.
#include "gs_core/error.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/stages.h"
#include "gs_train/named_row.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {
namespace {

struct LossRow {
  const char* name;  // a word of loss.kind
  std::unique_ptr<Loss> (*make)();
};
constexpr LossRow kLosses[] = {{"l1_ssim", make_l1_ssim_loss}};

class ScalarBackend final : public Backend {
 public:
  ScalarBackend() : Backend(host_memory()) {}
  std::string name() const override { return "cpu"; }
  Memory& memory() override { return host_memory(); }
  Renderer& renderer() override { return *renderer_; }
  void use_loss(const std::string& kind) override {
    const LossRow* const row = row_named(kLosses, kind, "loss.kind", " on " + name());
    if (row == loss_row_) return;  // the same loss keeps its last value
    loss_ = row->make();
    loss_row_ = row;
  }
  Loss& loss() override { return *loss_; }
  void use_photometric(std::unique_ptr<PhotometricModel> photometric) override {
    if (photometric) check_takes_appearance(*loss_, loss_row_->name);
    photometric_ = std::move(photometric);
  }
  void check_refines_poses() const override {}
  Optimizer& optimizer() override { return *optimizer_; }
  RowOps& rows() override { return *rows_; }
  void set_profiling(bool on) override { host_stage_clock().set_on(on); }
  std::vector<StageTime> stage_times() override { return host_stage_clock().times(); }

 protected:
  void find_pixel_values(const View& view, const DensityStep& density, RenderPass& pass) override {
    if (density.score == GrowthScore::force) return;  // sums no values
    gs::find_pixel_values(view, density, pass, appearance_.get(),
                          pass.scratch<ScalarScratch>().pixel_values);
  }
  void gather(const DensityStatistics& statistics, const RenderPass& pass,
              Span<const Vec2f> dL_dmean2d, ScorePooling pooling) override {
    const bool has_sums =
        statistics.has_sums && !pass.scratch<ScalarScratch>().fragment_sums.empty();
    parallel_for(dL_dmean2d.size, 4096, [&](std::size_t i) {
      if (!pass.tile_counts[i]) return;
      statistics.visits[i] += 1.0f;
      statistics.gradient_norm[i] += screen_gradient_norm(dL_dmean2d[i], pass.width, pass.height);
      if (has_sums) pool_with(statistics.sums[i], fragment_sums_of(pass, i), pooling);
    });
  }
  void add(Span<float> to, Span<const float> from, float weight) override {
    parallel_for(to.size, 16384, [=](std::size_t i) { to[i] += weight * from[i]; });
  }
  CameraGradient<double> camera_gradient(const GaussiansSpan& gaussians, const Camera& camera,
                                         const RenderSettings& settings,
                                         const RenderPass& pass) override {
    return gs::camera_gradient(gaussians, camera, settings, pass);
  }
  void update_photometric(PhotometricState& state, const Update& update,
                          std::vector<double>& gradient) override {
    gs::update_photometric(state, *photometric_, update.photometric_rate, update.photo_rule,
                           gradient);
  }
  void pool(Span<FragmentSums> all, Span<FragmentSums> more, ScorePooling pooling) override {
    parallel_for(all.size, 4096, [=](std::size_t i) { pool_with(all[i], more[i], pooling); });
  }

 private:
  std::unique_ptr<Renderer> renderer_ = make_scalar_renderer();
  const LossRow* loss_row_ = kLosses;
  std::unique_ptr<Loss> loss_ = loss_row_->make();
  std::unique_ptr<Optimizer> optimizer_ = make_scalar_optimizer();
  std::unique_ptr<RowOps> rows_ = make_scalar_row_ops();
};

}  // namespace

std::vector<std::string> scalar_losses() { return names_of(kLosses); }

std::unique_ptr<Backend> make_scalar_backend() { return std::make_unique<ScalarBackend>(); }

}  // namespace gs
