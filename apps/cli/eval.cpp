// SPDX-License-Identifier: Apache-2.0
// gemsplat eval: PSNR, SSIM, FLIP and LPIPS of a trained model against photos.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <iterator>
#include <memory>

#include "apps/cli/devices.h"
#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "gs_app/export/export_model.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/photometric_file.h"
#include "gs_app/run/progress_bar.h"
#include "gs_app/run/results.h"
#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/threads/parallel.h"
#include "gs_eval/depth_error.h"
#include "gs_eval/lpips/lpips.h"

namespace gs {
namespace {

struct EvalCommand : CommandLine {
  std::string model, split = "test", output;
  std::optional<int> step;
  bool json = false, corrects_colors = false;
};

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
  return fmt::format("{:>8.3f} dB  SSIM {:.4f}  FLIP {:.4f}{}  {}", view.psnr, view.ssim,
                     metrics.flip, lpips, view.name);
}

// A run with a photometric model is measured as when it ended.
EvaluationOptions options_of(const EvalCommand& command, const OpenedModel& opened,
                             const Scene& scene, Lpips* lpips) {
  EvaluationOptions options({true, lpips});
  options.is_corrected = command.corrects_colors || opened.config.eval.color_corrected;
  if (!opened.run || !std::filesystem::exists(opened.run->photometric())) return options;
  const SceneLooks looks = read_photometric(opened.run->photometric());
  options.appearance_of = appearances(looks);
  options.solved_appearance_of = solved_appearances(looks, scene);
  options.is_corrected = true;
  return options;
}

void eval(const EvalCommand& command) {
  setup_log(command.verbosity());
  std::optional<OutputLock> lock;
  if (!command.output.empty()) lock.emplace(OutputLock::of_file(command.output));
  OpenedModel opened = open_model(command.model, command.step);
  // A single file does not say which views were held out, so the usual rule applies.
  if (!opened.run) opened.config.dataset.eval = true;
  const Config config = resolve(command, opened.config);
  const std::unique_ptr<Lpips> lpips = make_lpips(config.eval);
  set_thread_count(config.train.threads);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  Scene scene = scene_for(opened, config.dataset, command.has("dataset.source"));
  const EvaluationOptions options = options_of(command, opened, scene, lpips.get());
  const std::vector<View> views = views_of(std::move(scene), command.split);
  if (lpips) lpips->check_sizes(views);
  const Gaussians gaussians = copy_to(backend->memory(), opened.model);
  const RenderSettings settings = view_settings(opened, config);
  const std::unique_ptr<PackedScene> scene_to_draw =
      backend->renderer().pack(gaussians.span(), settings);

  ProgressBar bar(std::int64_t(views.size()), !command.quiet);
  Evaluation evaluation = evaluate(
      backend->renderer(), *scene_to_draw, views, settings,
      [&](std::size_t index, const View&, const ImageF&) {
        const auto done = std::int64_t(index) + 1;
        if (bar.due(done)) bar.draw(done, "", "view");
      },
      options);
  bar.clear();
  measure_depth(backend->renderer(), gaussians, views, settings, evaluation);
  const std::string json = evaluation_json(evaluation, opened.ply.string(), command.split,
                                           gaussians.count(), backend->name());
  if (!command.output.empty()) {
    keep_older_aside(command.output);
    write_text(command.output, json);
  }
  if (command.json) {
    std::cout << json;
  } else {
    for (const ViewMetrics& view : evaluation.views) log_info("{}", line_of(view));
    std::cout << command.split << ": " << summary(evaluation) << ", "
              << with_commas(gaussians.count()) << " Gaussians\n";
  }
}

}  // namespace

void add_eval(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand("eval", "Measure a trained model against photos");
  const auto command = std::make_shared<EvalCommand>();
  verb.add_option("model", command->model,
                  "a run's folder, or a model in any format that gemsplat reads, with --data")
      ->type_name("RUN|MODEL")
      ->required();
  verb.add_option("--iteration", command->step,
                  "which model of a run: the one saved after this step [the newest]")
      ->type_name("STEP");
  verb.add_option("--split", command->split, "which views to measure [test]")
      ->check(CLI::IsMember({"test", "train", "all"}))
      ->type_name("");
  add_setting(verb, *command, "--lpips", "eval.lpips", "Metrics",
              "also measure LPIPS, with the weights in this file; none: without it");
  verb.add_flag("--color-corrected", command->corrects_colors,
                "also measure pictures whose colors are fitted to each photo");
  verb.add_flag("--json", command->json, "print JSON with the figures of every view");
  verb.add_option("-o,--output", command->output, "also write this JSON to a file")
      ->type_name("FILE");
  add_dataset_options(verb, *command, "-d,--data,-s,--source-path");
  add_render_options(verb, *command);
  add_general_options(verb, *command);
  verb.callback([command] { eval(*command); });
}

}  // namespace gs
