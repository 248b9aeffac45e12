// SPDX-License-Identifier: Apache-2.0
// gemsplat bench: times training and rendering of a trained or a generated model on one device.
#include <CLI/CLI.hpp>
#include <cmath>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/cli/devices.h"
#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_app/checks/benchmark.h"
#include "gs_app/checks/blenders.h"
#include "gs_app/checks/generated_scene.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/results.h"
#include "gs_app/run/run_folder.h"
#include "gs_app/run/text.h"
#include "gs_core/error.h"
#include "gs_core/math/constants.h"
#include "gs_core/parallel.h"
#include "gs_core/version.h"
#include "gs_render/render_settings.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kMostGaussians = 100'000'000, kMostViews = 1000, kMostRuns = 1'000'000;

struct BenchCommand : CommandLine {
  std::string model, output;
  std::optional<int> iteration;
  int gaussians = 0;  // of a generated scene; 0 for a trained model
  int width = 1280, height = 720, views = 8;
  BenchmarkPlan plan;
  bool json = false, blenders = false;
};

/// The model and views that are timed.
struct Subject {
  std::string model, scene;  // their files, or "generated"
  GaussianModel gaussians;
  std::vector<View> train_views, test_views;
  RenderSettings settings;
  Config config;

  const std::vector<View>& rendered_views() const {
    return test_views.empty() ? train_views : test_views;
  }
};

struct Report {
  std::string device;
  TrainingFigures training;
  Workload workload;  // of a training view, averaged
  std::vector<RenderingFigures> rendering;
  std::vector<BlenderFigures> blenders;
  std::optional<double> copy_gb_per_second;
  std::optional<std::size_t> peak_gpu_bytes;
};

Subject generated_subject(const BenchCommand& command) {
  SceneRecipe recipe;
  recipe.gaussians = std::size_t(command.gaussians);
  recipe.width = command.width;
  recipe.height = command.height;
  recipe.views = command.views;
  Subject subject;
  subject.model = subject.scene = "generated";
  subject.config = resolve(command);
  set_thread_count(subject.config.train.threads);
  subject.settings = render_settings(subject.config);
  GeneratedScene scene = generated_scene(recipe);
  subject.gaussians = std::move(scene.model);
  subject.train_views = std::move(scene.views);
  return subject;
}

Subject trained_subject(const BenchCommand& command) {
  OpenedModel opened = open_model(command.model, command.iteration);
  // A bare model does not say which views were held out; the usual rule is assumed.
  if (!opened.run) opened.config.dataset.eval = true;
  Subject subject;
  subject.config = resolve(command, opened.config);
  const DatasetConfig& dataset = subject.config.dataset;
  if (dataset.source.empty())
    throw UsageError("the model has no views to time; give its scene with --data SCENE");
  set_thread_count(subject.config.train.threads);
  subject.model = opened.ply.string();
  subject.scene = dataset.source;
  subject.settings = view_settings(opened, subject.config);
  Scene scene = load_scene(dataset);
  if (scene.train_views.empty())
    throw Error("there are no training views in " + scene.source +
                "; hold out fewer views (--test-every) or check the reconstruction");
  subject.gaussians = std::move(opened.model);
  subject.train_views = std::move(scene.train_views);
  subject.test_views = std::move(scene.test_views);
  return subject;
}

Subject subject_of(const BenchCommand& command) {
  const bool is_generated = command.gaussians > 0;
  if (is_generated == !command.model.empty())
    throw UsageError(
        "give one of these to time: a run's folder, a PLY with --data SCENE, or --gaussians N "
        "for a generated scene");
  if (is_generated && (command.has("dataset.source") || command.has("dataset.resolution")))
    throw UsageError(
        "--data and -r are for a run or a PLY; with --gaussians use --width and --height");
  return is_generated ? generated_subject(command) : trained_subject(command);
}

Report measure(const Subject& subject, const BenchmarkPlan& plan, bool with_blenders) {
  const std::unique_ptr<Backend> backend = make_backend(subject.config.train.device);
  if (with_blenders && &backend->memory() == &host_memory())
    throw UsageError("--blenders compares the blenders of a GPU; add --device cuda");
  Report report;
  report.device = backend->name();
  {
    TrainingModel model = benchmark_model(*backend, subject.gaussians);
    report.workload = mean_workload(*backend, model, subject.train_views, subject.settings);
    log_info("timing training: {} warm-up steps, then {} steps twice", plan.warmup, plan.steps);
    report.training = time_training(*backend, model, subject.train_views, subject.settings,
                                    subject.config, plan, report.workload);
    report.peak_gpu_bytes = peak_gpu_bytes(*backend);
    for (const double scale : plan.scales) {
      log_info("timing rendering: {} views, {} frames each, at scale {:g}",
               subject.rendered_views().size(), 2 * plan.frames + 1, scale);
      report.rendering.push_back(
          time_rendering(*backend, model, subject.rendered_views(), subject.settings, plan, scale));
    }
    if (with_blenders)
      report.blenders =
          compare_blenders(*backend, model, subject.rendered_views(), subject.settings, plan);
  }
  log_info("timing copies in memory");
  report.copy_gb_per_second = copy_gb_per_second(*backend);  // last, because it takes memory itself
  return report;
}

// As JSON

template <class T>
Json or_null(const std::optional<T>& value) {
  return value ? Json(*value) : Json(nullptr);
}

std::optional<double> share_of_copy(const StageFigures& stage, const Report& report) {
  if (!stage.gb_per_second || !report.copy_gb_per_second) return std::nullopt;
  return *stage.gb_per_second / *report.copy_gb_per_second;
}

Json stages_json(const std::vector<StageFigures>& stages, const Report& report) {
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

Json rendering_json(const RenderingFigures& figures, const Report& report) {
  return {{"scale", figures.scale},
          {"width", figures.width},
          {"height", figures.height},
          {"visible", figures.mean.visible},
          {"instances", figures.mean.instances},
          {"longest_list", figures.mean.longest_list},
          {"ms_per_frame", figures.ms_per_frame},
          {"stages", stages_json(figures.stages, report)}};
}

Json blender_json(const BlenderFigures& figures) {
  return {{"bounds", figures.bounds},
          {"blender", figures.blender},
          {"scale", figures.scale},
          {"width", figures.width},
          {"height", figures.height},
          {"instances", figures.instances},
          {"ms_per_frame", figures.ms_per_frame},
          {"blend_ms", figures.blend_ms},
          {"psnr", std::isfinite(figures.psnr) ? Json(figures.psnr) : Json(nullptr)},
          {"largest_difference", figures.largest},
          {"pixels", figures.pixels},
          {"pixels_apart", figures.apart},
          {"unexplained", figures.unexplained},
          {"unexplained_borderline", figures.borderline}};
}

std::string report_json(const Subject& subject, const BenchmarkPlan& plan, const Report& report) {
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
  json["train"] = {{"steps", plan.steps},
                   {"warmup", plan.warmup},
                   {"ms_per_step", report.training.ms_per_step},
                   {"stages", stages_json(report.training.stages, report)}};
  json["render"] = Json::array();
  for (const RenderingFigures& figures : report.rendering)
    json["render"].push_back(rendering_json(figures, report));
  for (const BlenderFigures& figures : report.blenders)
    json["blenders"].push_back(blender_json(figures));
  json["copy_gb_per_s"] = or_null(report.copy_gb_per_second);
  if (report.peak_gpu_bytes) json["peak_gpu_bytes"] = *report.peak_gpu_bytes;
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

// As a table

std::string stages_text(const std::vector<StageFigures>& stages, const Report& report) {
  if (stages.empty()) return "";
  std::string text = fmt::format("  {:<26} {:>8} {:>7} {:>9} {:>7} {:>8}\n", "stage", "ms", "share",
                                 "MB", "GB/s", "of copy");
  for (const StageFigures& stage : stages) {
    text += fmt::format("  {:<26} {:>8.3f} {:>6.1f}%", stage.stage, stage.milliseconds,
                        100 * stage.share);
    if (stage.bytes && stage.gb_per_second)
      text += fmt::format(" {:>9.1f} {:>7.0f}", *stage.bytes * 1e-6, *stage.gb_per_second);
    if (const auto share = share_of_copy(stage, report))
      text += fmt::format(" {:>7.0f}%", 100 * *share);
    text += "\n";
  }
  return text;
}

std::string blenders_text(const std::vector<BlenderFigures>& blenders) {
  if (blenders.empty()) return "";
  std::string text = fmt::format(
      "\nblenders, compared with simt at the same bounds\n"
      "  differing: pixels with a channel that differs by more than {:g}\n"
      "  unexplained: of these, pixels that are wrong by more than rounding of alpha by {:g} "
      "explains; margin: the largest of theirs\n  "
      "{:<7} {:<10} {:>11} {:>9} {:>9} {:>9} {:>7} "
      "{:>9} {:>9} {:>11} {:>8}\n",
      kBlendersAgree, kBorderline, "bounds", "blender", "size", "instances", "frame ms", "blend ms",
      "PSNR", "largest", "differing", "unexplained", "margin");
  for (const BlenderFigures& f : blenders)
    text += fmt::format(
        "  {:<7} {:<10} {:>11} {:>9} {:>9.3f} {:>9.3f} {:>7.1f} {:>9.1e} {:>9} {:>11} {:>8}\n",
        f.bounds, f.blender, fmt::format("{}x{}", f.width, f.height),
        with_commas(std::uint64_t(f.instances + 0.5)), f.ms_per_frame, f.blend_ms, f.psnr,
        f.largest, f.apart, f.unexplained,
        f.unexplained ? fmt::format("{:.1e}", f.borderline) : "");
  return text;
}

std::string workload_text(const Workload& workload) {
  return fmt::format("{} visible Gaussians and {} instances per view, {} in the fullest tile",
                     with_commas(std::uint64_t(workload.visible + 0.5)),
                     with_commas(std::uint64_t(workload.instances + 0.5)),
                     with_commas(std::uint64_t(workload.longest_list + 0.5)));
}

std::string report_text(const Subject& subject, const BenchmarkPlan& plan, const Report& report) {
  const Camera& camera = subject.train_views.front().camera;
  const std::size_t rendered = subject.rendered_views().size();
  std::string text = fmt::format("{}, gemsplat {}\n", report.device, kVersion);
  text += fmt::format("model: {}, {} Gaussians; scene: {}\n", subject.model,
                      with_commas(subject.gaussians.gaussians.count()), subject.scene);
  text += fmt::format(
      "\ntraining: {:.3f} ms per step ({} steps after {} warm-up steps), {}x{}, {} views\n",
      report.training.ms_per_step, plan.steps, plan.warmup, camera.width, camera.height,
      subject.train_views.size());
  text += "  " + workload_text(report.workload) + "\n";
  text += stages_text(report.training.stages, report);
  for (const RenderingFigures& figures : report.rendering) {
    text += fmt::format("\nrendering: {:.3f} ms per frame, {}x{}, {} {} views\n",
                        figures.ms_per_frame, figures.width, figures.height, rendered,
                        subject.test_views.empty() ? "training" : "test");
    text += "  " + workload_text(figures.mean) + "\n" + stages_text(figures.stages, report);
  }
  text += blenders_text(report.blenders) + "\n";
  if (report.copy_gb_per_second)
    text += fmt::format("copies in memory: {:.0f} GB/s, reads and writes together\n",
                        *report.copy_gb_per_second);
  if (report.peak_gpu_bytes)
    text += fmt::format("peak GPU memory until the last step: {} MiB\n",
                        with_commas(*report.peak_gpu_bytes >> 20));
  return text;
}

void bench(const BenchCommand& command) {
  setup_log(command.verbosity());
  const Subject subject = subject_of(command);
  check_scales(subject.rendered_views(), command.plan.scales);
  const Report report = measure(subject, command.plan, command.blenders);
  const std::string json = report_json(subject, command.plan, report);
  if (!command.output.empty()) write_text(command.output, json);
  std::cout << (command.json ? json : report_text(subject, command.plan, report));
}

void add_generator_options(CLI::App& verb, BenchCommand& command) {
  const auto add = [&](const char* name, int& value, int most, const char* help) {
    verb.add_option(name, value, help)
        ->check(CLI::Range(1, most))
        ->type_name("N")
        ->group("Generated scene");
  };
  add("--gaussians", command.gaussians, kMostGaussians,
      "time a generated scene with this many random Gaussians");
  add("--width", command.width, kMaxPictureSide, "width of its views in pixels [1280]");
  add("--height", command.height, kMaxPictureSide, "height of its views in pixels [720]");
  add("--views", command.views, kMostViews, "number of its views [8]");
}

void add_plan_options(CLI::App& verb, BenchmarkPlan& plan) {
  const auto add = [&](const char* name, int& value, int least, const char* help) {
    verb.add_option(name, value, help)
        ->check(CLI::Range(least, kMostRuns))
        ->type_name("N")
        ->group("Measuring");
  };
  add("--steps", plan.steps, 1, "timed training steps [200]");
  add("--warmup", plan.warmup, 0, "untimed training steps before them [50]");
  add("--frames", plan.frames, 1, "timed frames of each view, after one untimed frame [5]");
  verb.add_option("--scales", plan.scales,
                  "sizes of rendered pictures, as multiples of the views' size [1]")
      ->check(CLI::Range(0.01, 100.0))
      ->delimiter(',')
      ->type_name("X,...")
      ->group("Measuring");
}

}  // namespace

void add_bench(CLI::App& program) {
  CLI::App& verb =
      *program.add_subcommand("bench", "Time training and rendering; on a GPU stage by stage");
  const auto command = std::make_shared<BenchCommand>();
  verb.add_option("model", command->model, "a run's folder, or a PLY with --data")
      ->type_name("RUN|PLY");
  verb.add_option("--iteration", command->iteration,
                  "which model of a run: the one saved after this step [the newest]")
      ->type_name("STEP");
  verb.add_flag("--json", command->json, "print JSON");
  verb.add_option("-o,--output", command->output, "also write the JSON to a file")
      ->type_name("FILE");
  verb.add_flag("--blenders", command->blenders,
                "compare speed and pictures of the GPU's blenders with each kind of tile bounds");
  add_generator_options(verb, *command);
  add_plan_options(verb, command->plan);
  add_dataset_options(verb, *command, "-d,--data,-s,--source-path");
  add_render_options(verb, *command);
  add_general_options(verb, *command);
  verb.callback([command] { bench(*command); });
}

}  // namespace gs
