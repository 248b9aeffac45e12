// SPDX-License-Identifier: Apache-2.0
#include "gs_app/run/results.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "gs_app/run/provenance.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"

#ifdef GS_HAVE_CUDA
#include "cuda/backend.h"
#endif

namespace gs {
namespace {

void add_perceptual(const char* suffix, const std::optional<PerceptualMetrics>& metrics,
                    Json& json) {
  if (!metrics) return;
  json[fmt::format("flip{}", suffix)] = metrics->flip;
  if (metrics->lpips) json[fmt::format("lpips{}", suffix)] = *metrics->lpips;
}

void add_picture(const char* suffix, const std::optional<PictureMetrics>& metrics, Json& json) {
  if (!metrics) return;
  json[fmt::format("psnr{}", suffix)] = metrics->psnr;
  json[fmt::format("ssim{}", suffix)] = metrics->ssim;
}

void add_panorama(const std::optional<PanoramaMetrics>& metrics, Json& json) {
  if (!metrics) return;
  add_picture("_panorama", *metrics, json);
  json["ws_psnr"] = metrics->ws_psnr;
}

Json means(const Evaluation& evaluation) {
  if (evaluation.views.empty()) return nullptr;
  Json json = {{"psnr", evaluation.psnr}, {"ssim", evaluation.ssim}};
  add_perceptual("", evaluation.perceptual, json);
  json["num_views"] = evaluation.views.size();
  if (evaluation.has_exposures) {
    json["psnr_exposure"] = evaluation.psnr_exposure;
    json["ssim_exposure"] = evaluation.ssim_exposure;
    add_perceptual("_exposure", evaluation.perceptual_exposure, json);
  }
  add_picture("_photometric", evaluation.photometric, json);
  add_picture("_cc", evaluation.corrected, json);
  add_panorama(evaluation.panorama, json);
  if (evaluation.depth_error) json["depth_error"] = *evaluation.depth_error;
  if (evaluation.normal_angle) json["normal_angle"] = *evaluation.normal_angle;
  return json;
}

// The network behind "lpips", where it was measured.
void add_network(const std::optional<LpipsSource>& source, Json& json) {
  if (source)
    json["lpips_network"] = {
        {"name", source->network}, {"file", source->file}, {"hash", source->hash}};
}

Json photometric_json(const SceneLooks& looks) {
  Json spreads = Json::object();
  for (const HeldOutRule& rule : looks.rules) spreads[rule.name] = rule.spread;
  return {{"model", looks.config.model}, {"rule", looks.rule}, {"spreads", spreads}};
}

Json by_view(const Evaluation& evaluation) {
  Json result = Json::object();
  const bool has_times = std::any_of(evaluation.views.begin(), evaluation.views.end(),
                                     [](const ViewMetrics& view) { return view.time != 0; });
  for (const ViewMetrics& view : evaluation.views) {
    Json& json = result[view.name] = {{"psnr", view.psnr}, {"ssim", view.ssim}};
    add_perceptual("", view.perceptual, json);
    if (has_times) json["time"] = view.time;
    add_picture("_photometric", view.photometric, json);
    add_picture("_cc", view.corrected, json);
    add_panorama(view.panorama, json);
    if (view.depth_error) json["depth_error"] = *view.depth_error;
    if (!evaluation.has_exposures) continue;
    json["psnr_exposure"] = view.psnr_exposure;
    json["ssim_exposure"] = view.ssim_exposure;
    add_perceptual("_exposure", view.perceptual_exposure, json);
  }
  return result;
}

}  // namespace

std::optional<std::size_t> peak_gpu_bytes([[maybe_unused]] Backend& backend) {
#ifdef GS_HAVE_CUDA
  if (&backend.memory() != &host_memory()) return cuda::usage().peak_allocated_bytes;
#endif
  return std::nullopt;
}

std::optional<std::size_t> gpu_bytes([[maybe_unused]] Backend& backend) {
#ifdef GS_HAVE_CUDA
  if (&backend.memory() != &host_memory()) return cuda::usage().allocated_bytes;
#endif
  return std::nullopt;
}

std::string results_json(const Results& results) {
  Json json = {{"iterations", results.iterations},
               {"num_gaussians", results.num_gaussians},
               {"removed_floaters", results.removed_floaters},
               {"train_seconds", results.train_seconds},
               {"wall_seconds", Json::object()},
               {"test", means(results.test)},
               {"train", means(results.train)},
               {"device", results.device},
               {"version", kVersion},
               {"seed", results.seed},
               {"commit", built_commit()},
               {"compiler", built_compiler()},
               {"cpu", cpu_name()},
               {"date", utc_date()},
               {"scene_hash", results.scene_hash},
               {"peak_host_bytes", peak_host_bytes()}};
  for (const auto& [part, seconds] : results.wall_seconds) json["wall_seconds"][part] = seconds;
  if (const auto& changes = uncommitted_changes()) json["uncommitted"] = changes->hash;
  if (const CudaBuild cuda = built_cuda(); !cuda.toolkit.empty()) json["cuda"] = cuda.toolkit;
  add_network(results.test.lpips_source ? results.test.lpips_source : results.train.lpips_source,
              json);
  if (const Vec3d& offset = results.world_offset; offset != Vec3d(0.0))
    json["world_offset"] = {offset.x, offset.y, offset.z};
  if (const auto& refinement = results.refinement)
    json["refinement"] = {{"observations", refinement->observations},
                          {"images", refinement->images},
                          {"points", refinement->points},
                          {"mean_error_before", refinement->mean_error_before},
                          {"mean_error_after", refinement->mean_error_after},
                          {"median_error_before", refinement->median_error_before},
                          {"median_error_after", refinement->median_error_after},
                          {"steps", refinement->steps},
                          {"has_converged", refinement->has_converged},
                          {"seconds", refinement->seconds}};
  if (results.exposure)
    json["exposure"] = {{"samples", results.exposure->samples},
                        {"spread_before", results.exposure->spread_before},
                        {"spread_after", results.exposure->spread_after}};
  if (results.looks) json["photometric"] = photometric_json(*results.looks);
  if (results.poses)
    json["poses"] = {{"degrees", results.poses->degrees}, {"shift", results.poses->shift}};
  if (results.peak_gpu_bytes) {
    json["peak_gpu_bytes"] = *results.peak_gpu_bytes;
    if (results.forecast_gpu_bytes)
      json["forecast_gpu_bytes"] = std::llround(*results.forecast_gpu_bytes);
    json["driver"] = gpu_driver();
  }
  return file_text(json);
}

std::string per_view_json(const Results& results) {
  return file_text(Json{{"test", by_view(results.test)}, {"train", by_view(results.train)}});
}

std::string evaluation_json(const Evaluation& evaluation, const std::string& model,
                            const std::string& split, std::size_t num_gaussians,
                            const std::string& device) {
  Json json = {{"model", model}, {"split", split}};
  json.update(means(evaluation));
  json["num_gaussians"] = num_gaussians;
  json["device"] = device;
  json["version"] = kVersion;
  add_network(evaluation.lpips_source, json);
  json["views"] = by_view(evaluation);
  return file_text(json);
}

std::string summary(const Evaluation& evaluation) {
  const std::size_t views = evaluation.views.size();
  std::string text = fmt::format("{:.2f} dB PSNR, {:.4f} SSIM", evaluation.psnr, evaluation.ssim);
  if (const auto& perceptual = evaluation.perceptual) {
    text += fmt::format(", {:.4f} FLIP", perceptual->flip);
    if (perceptual->lpips) text += fmt::format(", {:.4f} LPIPS", *perceptual->lpips);
  }
  text += fmt::format(" over {} view{}", views, views == 1 ? "" : "s");
  if (evaluation.has_exposures)
    text += fmt::format("; under their exposures {:.2f} dB, {:.4f}", evaluation.psnr_exposure,
                        evaluation.ssim_exposure);
  if (evaluation.photometric)
    text += fmt::format("; as the photometric model shows them {:.2f} dB, {:.4f}",
                        evaluation.photometric->psnr, evaluation.photometric->ssim);
  if (evaluation.corrected)
    text += fmt::format("; with colors fitted to the photos {:.2f} dB, {:.4f}",
                        evaluation.corrected->psnr, evaluation.corrected->ssim);
  if (const auto& panorama = evaluation.panorama)
    text += fmt::format("; panoramas as one picture {:.2f} dB, {:.2f} dB WS-PSNR, {:.4f}",
                        panorama->psnr, panorama->ws_psnr, panorama->ssim);
  if (evaluation.depth_error)
    text += fmt::format("; depth is off by {:.1f} % on average", 100 * *evaluation.depth_error);
  if (evaluation.normal_angle)
    text += fmt::format("; normals are {:.1f} degrees off the surface", *evaluation.normal_angle);
  return text;
}

}  // namespace gs
