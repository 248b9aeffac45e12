// SPDX-License-Identifier: Apache-2.0
// The scalar CPU backend: the contracts in their simplest form.
#include "gs_train/stages/scalar_backend.h"

#include "gs_core/threads/parallel.h"
#include "gs_render/stages.h"
#include "gs_train/named_row.h"
#include "gs_train/stages/scalar_stages.h"

namespace gs {

struct ScalarLoss {
  const char* name;  // a word of loss.kind
  std::unique_ptr<Loss> (*make)();
};

namespace {

constexpr ScalarLoss kLosses[] = {{"l1_ssim", make_l1_ssim_loss}};

}  // namespace

ScalarBackend::ScalarBackend()
    : Backend(host_memory()), renderer_(make_scalar_renderer()), loss_row_(kLosses),
      loss_(loss_row_->make()), optimizer_(make_scalar_optimizer()), rows_(make_scalar_row_ops()) {}

void ScalarBackend::use_loss(const std::string& kind) {
  const ScalarLoss* const row = row_named(kLosses, kind, "loss.kind", " on " + name());
  if (row == loss_row_) return;  // the same loss keeps its last value
  loss_ = row->make();
  loss_row_ = row;
}

void ScalarBackend::use_photometric(std::shared_ptr<const PhotometricModel> photometric) {
  if (photometric) check_takes_appearance(*loss_, loss_row_->name);
  photometric_ = std::move(photometric);
}

void ScalarBackend::set_profiling(bool on) { host_stage_clock().set_on(on); }

std::vector<StageTime> ScalarBackend::stage_times() { return host_stage_clock().times(); }

void ScalarBackend::add_pixel_scores(const View& view, const RenderSettings& settings,
                                     const PixelRule& rule, RenderPass& pass,
                                     Span<FragmentSums> to) {
  find_pixel_values(view, rule, pass, appearance_.get(), pixel_values_);
  blend_values(settings, pixel_values_.span(), pass);
  parallel_for(to.size, 4096, [&](std::size_t i) {
    if (pass.tile_counts[i]) add_to(to[i], fragment_sums_of(pass, i));
  });
}

void ScalarBackend::compare_depth(const View& view, const RenderSettings& settings, float weight,
                                  RenderPass& pass) {
  blend_depth(settings, pass, depth_planes_);
  gs::compare_depth(view, weight, depth_planes_, dL_dplanes_);
  blend_depth_backward(settings, dL_dplanes_.span(), depth_planes_, pass);
}

void ScalarBackend::gather(const DensityStatistics& statistics, const RenderPass& pass,
                           Span<const Vec2f> dL_dmean2d) {
  const bool has_sums = statistics.has_sums && !pass.scratch<ScalarScratch>().fragment_sums.empty();
  parallel_for(dL_dmean2d.size, 4096, [&](std::size_t i) {
    if (!pass.tile_counts[i]) return;
    statistics.visits[i] += 1.0f;
    statistics.gradient_norm[i] += screen_gradient_norm(dL_dmean2d[i], pass.width, pass.height);
    if (has_sums) add_to(statistics.sums[i], fragment_sums_of(pass, i));
  });
}

void ScalarBackend::add(Span<float> to, Span<const float> from, float weight) {
  parallel_for(to.size, 16384, [=](std::size_t i) { to[i] += weight * from[i]; });
}

CameraGradient<double> ScalarBackend::camera_gradient(const GaussiansSpan& gaussians,
                                                      const Camera& camera,
                                                      const RenderSettings& settings,
                                                      const RenderPass& pass) {
  return gs::camera_gradient(gaussians, camera, settings, pass);
}

void ScalarBackend::update_photometric(PhotometricState& state, const Update& update,
                                       std::vector<double>& gradient) {
  gs::update_photometric(state, *photometric_, update.photometric_rate, update.photo_rule,
                         gradient);
}

void ScalarBackend::add(Span<FragmentSums> to, Span<FragmentSums> from) {
  parallel_for(to.size, 4096, [=](std::size_t i) { add_to(to[i], from[i]); });
}

std::vector<std::string> scalar_losses() { return names_of(kLosses); }

std::unique_ptr<Backend> make_scalar_backend() { return std::make_unique<ScalarBackend>(); }

}  // namespace gs
