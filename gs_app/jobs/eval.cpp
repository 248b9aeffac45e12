// SPDX-License-Identifier: Apache-2.0
// gemsplat eval: PSNR, SSIM, FLIP and LPIPS of a trained model against photos.
#include <algorithm>
#include <iterator>

#include "gs_app/export/export_model.h"
#include "gs_app/export/view_pictures.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/photometric_file.h"
#include "gs_app/run/results.h"
#include "gs_app/run/text.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_eval/depth_error.h"
#include "gs_eval/lpips/lpips.h"
#include "gs_eval/normal_angle.h"
#include "gs_eval/popping.h"

namespace gs {
namespace {

struct EvalJob : JobSettings {
  std::string model, split = "test", output;
  ModelChoice choice;
  bool corrects_colors = false, measures_popping = false;
};

void visit_options(EvalJob& job, OptionList& option) {
  option.json_meaning = "print JSON with the figures of every view";
  option("model", job.model,
         "a run's folder, or a model in any format that gemsplat reads, with --data")
      .takes("RUN|MODEL")
      .required();
  model_options(option, job.choice);
  option("--split", job.split, "which views to measure [test]").one_of({"test", "train", "all"});
  option.setting("--lpips", "eval.lpips", "Metrics",
                 "also measure LPIPS, with the weights in this file; none: without it");
  option("--color-corrected", job.corrects_colors,
         "also measure pictures whose colors are fitted to each photo");
  option("--popping", job.measures_popping,
         "also measure what pops up when a camera turns: FLIP between frames of a pan and their "
         "neighbors, turned to the same camera");
  option("-o,--output", job.output, "also write the JSON to a file").takes("FILE");
  dataset_options(option, "-d,--data,-s,--source-path");
  render_options(option);
  general_options(option);
}

std::vector<View> views_of(Scene scene, const std::string& split) {
  std::vector<View> views = std::move(split == "train" ? scene.train_views : scene.test_views);
  if (split == "all") {
    std::move(scene.train_views.begin(), scene.train_views.end(), std::back_inserter(views));
    std::sort(views.begin(), views.end(),
              [](const View& a, const View& b) { return a.name < b.name; });
  }
  if (views.empty())
    throw UsageError("the run held out no views; give --split train or --split all");
  return views;
}

std::string line_of(const ViewMetrics& view) {
  const PerceptualMetrics& metrics = *view.perceptual;
  const std::string lpips = metrics.lpips ? fmt::format("  LPIPS {:.4f}", *metrics.lpips) : "";
  std::string panorama;
  if (view.panorama)
    panorama = fmt::format("; the whole panorama {:.3f} dB  WS-PSNR {:.3f} dB  SSIM {:.4f}",
                           view.panorama->psnr, view.panorama->ws_psnr, view.panorama->ssim);
  return fmt::format("{:>8.3f} dB  SSIM {:.4f}  FLIP {:.4f}{}  {}{}", view.psnr, view.ssim,
                     metrics.flip, lpips, view.name, panorama);
}

// A run with a photometric model is measured as when it ended.
EvaluationOptions options_of(const EvalJob& job, const OpenedModel& opened, const Scene& scene,
                             Lpips* lpips) {
  EvaluationOptions options({true, lpips});
  options.is_corrected = job.corrects_colors || opened.config.eval.color_corrected;
  if (!opened.run || !std::filesystem::exists(opened.run->photometric())) return options;
  const SceneLooks looks = read_photometric(opened.run->photometric());
  options.appearance_of = appearances(looks);
  options.solved_appearance_of = solved_appearances(looks, scene);
  options.is_corrected = true;
  return options;
}

constexpr int kPanWidth = 800;  // pixels, at most

// Of pans at the views' places, by pinholes.
Popping popping_of(ViewPictures& pictures, const std::vector<View>& views) {
  std::vector<Camera> cameras;
  for (const View& view : views) {
    cameras.push_back(at_resolution(view.camera, std::min(view.camera.width, kPanWidth)));
    cameras.back().lens = {};
  }
  return measure_popping(cameras, [&](const Camera& camera) {
    return std::move(pictures.values(camera, {Quantity::color}).front());
  });
}

Outcome run(const EvalJob& job, JobEvents& events) {
  std::optional<OutputLock> lock;
  if (!job.output.empty()) lock.emplace(OutputLock::of_file(job.output));
  OpenedModel opened = open_model(job.model, job.choice.step);
  // A single file does not say which views were held out, so the usual rule applies.
  if (!opened.run) opened.config.dataset.eval = true;
  const Config config = resolve_to_work(job, opened.config);
  const std::unique_ptr<Lpips> lpips = make_lpips(config.eval);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  Scene scene = scene_for(opened, config.dataset, job.has("dataset.source"));
  const EvaluationOptions options = options_of(job, opened, scene, lpips.get());
  const std::vector<View> views = views_of(std::move(scene), job.split);
  if (lpips) lpips->check_sizes(views);
  const Gaussians gaussians = copy_to(backend->memory(), opened.model);
  const RenderSettings settings = view_settings(opened, config);
  const std::unique_ptr<PackedScene> scene_to_draw =
      backend->renderer().pack(gaussians.span(), settings);
  Evaluation evaluation = evaluate(
      backend->renderer(), *scene_to_draw, views, settings,
      [&](std::size_t index, const View&, const ImageF&) {
        events.progress("", "view", index + 1, views.size());
      },
      options);
  measure_depth(backend->renderer(), gaussians, views, settings, evaluation);
  if (config.surface.is_on())
    measure_normals(backend->renderer(), gaussians, views, settings, evaluation);
  std::string json = evaluation_json(evaluation, opened.ply.string(), job.split, gaussians.count(),
                                     backend->name());
  std::string text = summary(evaluation);
  if (job.measures_popping) {
    ViewPictures pictures(*backend, gaussians, opened.model.gaussians, settings, false);
    const Popping popping = popping_of(pictures, views);
    Json with_popping = Json::parse(json);
    with_popping["popping"] = {{"flip_next", popping.next}, {"flip_seventh", popping.seventh}};
    json = file_text(with_popping);
    text += fmt::format("; popping {:.4f} FLIP to the next frame, {:.4f} to the seventh",
                        popping.next, popping.seventh);
  }
  if (!job.output.empty()) {
    keep_older_aside(job.output);
    write_text(job.output, json);
  }
  if (!events.wants_json())
    for (const ViewMetrics& view : evaluation.views) log_info("{}", line_of(view));
  return {fmt::format("{}: {}, {} Gaussians\n", job.split, text, with_commas(gaussians.count())),
          Json::parse(json),
          {{"look at it", "gemsplat view " + shell_word(job.model)}},
          true};
}

}  // namespace

Verb eval_verb() {
  return verb_of<EvalJob>("eval", VerbGroup::compare, "Measure a trained model against photos",
                          {"eval out/scene", "eval model.ply --data scene --json",
                           "eval out/scene --split all --lpips vgg16.bin -o metrics.json"});
}

}  // namespace gs
