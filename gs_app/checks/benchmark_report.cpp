// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checks/benchmark_report.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "gs_app/run/text.h"
#include "gs_core/system/text/json.h"
#include "gs_core/system/version.h"

namespace gs {
namespace {

// As JSON

template <class T>
Json or_null(const std::optional<T>& value) {
  return value ? Json(*value) : Json(nullptr);
}

std::optional<double> share_of_copy(const StageFigures& stage, const BenchmarkReport& report) {
  if (!stage.gb_per_second || !report.copy_gb_per_second) return std::nullopt;
  return *stage.gb_per_second / *report.copy_gb_per_second;
}

Json stages_json(const std::vector<StageFigures>& stages, const BenchmarkReport& report) {
  Json list = Json::array();
  for (const StageFigures& stage : stages)
    list.push_back({{"stage", stage.stage},
                    {"ms", stage.milliseconds},
                    {"share", stage.share},
                    {"bytes", or_null(stage.bytes)},
                    {"gb_per_s", or_null(stage.gb_per_second)},
                    {"share_of_copy", or_null(share_of_copy(stage, report))}});
  return list;
}

Json rendering_json(const RenderingFigures& figures, const BenchmarkReport& report) {
  return {{"scale", figures.scale},
          {"width", figures.width},
          {"height", figures.height},
          {"visible", figures.mean.visible},
          {"instances", figures.mean.instances},
          {"longest_list", figures.mean.longest_list},
          {"ms_per_frame", figures.ms_per_frame},
          {"stages", stages_json(figures.stages, report)}};
}

// What the times include, for readers of a table in which they stand beside others.
constexpr const char* kStepProtocol =
    "wall time of the timed steps over their number, with the wait for the device at the end; all "
    "stages from projection to Adam; without loading, decoding and uploading photos, density "
    "control and evaluation";
constexpr const char* kFrameProtocol =
    "the host's clock from a camera to a picture in the device's memory (three channels and "
    "transmittance in fp32), with the wait for the device at the end of each frame; the median "
    "of a view's frames, the mean over the views; the model lies ready in memory, SH beyond "
    "degree 0 in 16 bits";

// As a table

std::string stages_text(const std::vector<StageFigures>& stages, const BenchmarkReport& report) {
  if (stages.empty()) return "";
  std::string text = fmt::format("  {:<26} {:>8} {:>7}", "stage", "ms", "share");
  const auto has_traffic = [](const StageFigures& s) { return s.bytes && s.gb_per_second; };
  if (std::ranges::any_of(stages, has_traffic))  // on a GPU
    text += fmt::format(" {:>9} {:>7} {:>8}", "MB", "GB/s", "of copy");
  text += "\n";
  for (const StageFigures& stage : stages) {
    text += fmt::format("  {:<26} {:>8.3f} {:>6.1f}%", stage.stage, stage.milliseconds,
                        100 * stage.share);
    if (has_traffic(stage))
      text += fmt::format(" {:>9.1f} {:>7.0f}", *stage.bytes * 1e-6, *stage.gb_per_second);
    if (const auto share = share_of_copy(stage, report))
      text += fmt::format(" {:>7.0f}%", 100 * *share);
    text += "\n";
  }
  return text;
}

std::string workload_text(const Workload& workload) {
  return fmt::format("{} visible Gaussians and {} instances per view, {} in the fullest tile",
                     with_commas(std::uint64_t(workload.visible + 0.5)),
                     with_commas(std::uint64_t(workload.instances + 0.5)),
                     with_commas(std::uint64_t(workload.longest_list + 0.5)));
}

}  // namespace

std::string report_json(const BenchmarkSubject& subject, const BenchmarkPlan& plan,
                        const BenchmarkReport& report) {
  const Camera& camera = subject.train_views.front().camera;
  Json json = {{"device", report.device},
               {"version", kVersion},
               {"model", subject.model},
               {"scene", subject.scene},
               {"width", camera.width},
               {"height", camera.height},
               {"sh_degree", subject.settings.sh_degree},
               {"num_gaussians", subject.gaussians.gaussians.count()},
               {"visible", report.workload.visible},
               {"instances", report.workload.instances},
               {"longest_list", report.workload.longest_list},
               {"train_views", subject.train_views.size()},
               {"test_views", subject.test_views.size()}};
  json["clock_mhz"] = or_null(report.clock_mhz);
  json["protocol"] = {{"step", kStepProtocol}, {"frame", kFrameProtocol}};
  json["train"] = {{"steps", plan.steps},
                   {"warmup", plan.warmup},
                   {"ms_per_step", report.training.ms_per_step},
                   {"batch", subject.config.train.batch},
                   {"ms_per_photo", report.training.ms_per_step / subject.config.train.batch},
                   {"stages", stages_json(report.training.stages, report)}};
  json["render"] = Json::array();
  for (const RenderingFigures& figures : report.rendering)
    json["render"].push_back(rendering_json(figures, report));
  json["copy_gb_per_s"] = or_null(report.copy_gb_per_second);
  if (report.peak_gpu_bytes) {
    json["peak_gpu_bytes"] = *report.peak_gpu_bytes;
    json["forecast_gpu_bytes"] = std::llround(report.forecast_gpu_bytes);
  }
  return file_text(json);
}

std::string report_text(const BenchmarkSubject& subject, const BenchmarkPlan& plan,
                        const BenchmarkReport& report) {
  const Camera& camera = subject.train_views.front().camera;
  const std::size_t rendered = subject.rendered_views().size();
  std::string text = fmt::format("{}, gemsplat {}\n", report.device, kVersion);
  text += fmt::format("model: {}, {} Gaussians; scene: {}\n", subject.model,
                      with_commas(subject.gaussians.gaussians.count()), subject.scene);
  const int batch = subject.config.train.batch;
  const std::string of_photos = batch > 1 ? fmt::format(" of {} photos, {:.3f} ms a photo", batch,
                                                        report.training.ms_per_step / batch)
                                          : "";
  text += fmt::format(
      "\ntraining: {:.3f} ms per step{} ({} steps after {} warm-up steps), {}x{}, {} views\n",
      report.training.ms_per_step, of_photos, plan.steps, plan.warmup, camera.width, camera.height,
      subject.train_views.size());
  text += "  " + workload_text(report.workload) + "\n";
  text += stages_text(report.training.stages, report);
  for (const RenderingFigures& figures : report.rendering) {
    text += fmt::format("\nrendering: {:.3f} ms per frame, {}x{}, {} {} views\n",
                        figures.ms_per_frame, figures.width, figures.height, rendered,
                        subject.test_views.empty() ? "training" : "test");
    text += "  " + workload_text(figures.mean) + "\n" + stages_text(figures.stages, report);
  }
  text += "\n";
  if (report.clock_mhz) text += fmt::format("clock while busy: {:.0f} MHz\n", *report.clock_mhz);
  if (report.copy_gb_per_second)
    text += fmt::format("copies in memory: {:.0f} GB/s, reads and writes together\n",
                        *report.copy_gb_per_second);
  if (report.peak_gpu_bytes)
    text += fmt::format("peak GPU memory until the last step: {} MiB; forecast: {} MiB\n",
                        with_commas(*report.peak_gpu_bytes >> 20),
                        with_commas(std::size_t(report.forecast_gpu_bytes) >> 20));
  return text;
}

}  // namespace gs
