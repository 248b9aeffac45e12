// SPDX-License-Identifier: Apache-2.0
// gemsplat bench: times training and rendering of a trained or a generated model on one device.
#include <CLI/CLI.hpp>
#include <filesystem>
#include <iostream>
#include <memory>

#include "apps/cli/devices.h"
#include "apps/cli/options.h"
#include "apps/cli/verbs.h"
#include "data_loaders/scene/load_scene.h"
#include "gs_app/checks/benchmark_comparison.h"
#include "gs_app/checks/benchmark_report.h"
#include "gs_app/checks/generated_scene.h"
#include "gs_app/export/export_model.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/results.h"
#include "gs_app/run/run_folder.h"
#include "gs_core/error.h"
#include "gs_core/math/constants.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_core/system/text/json.h"
#include "gs_core/threads/parallel.h"
#include "gs_render/render_settings.h"

namespace gs {
namespace {

constexpr int kMostGaussians = 100'000'000, kMostViews = 1000, kMostRuns = 1'000'000;

struct BenchCommand : CommandLine {
  std::string model, output;
  std::optional<int> iteration;
  int gaussians = 0;  // of a generated scene; 0 for a trained model
  int width = 1280, height = 720, views = 8;
  BenchmarkPlan plan;
  std::vector<std::string> against;
  bool json = false;
};

BenchmarkSubject generated_subject(const BenchCommand& command) {
  SceneRecipe recipe;
  recipe.gaussians = std::size_t(command.gaussians);
  recipe.width = command.width;
  recipe.height = command.height;
  recipe.views = command.views;
  BenchmarkSubject subject;
  subject.model = subject.scene = "generated";
  subject.config = resolve(command);
  set_thread_count(subject.config.train.threads);
  subject.settings = render_settings(subject.config);
  GeneratedScene scene = generated_scene(recipe);
  subject.gaussians = std::move(scene.model);
  subject.train_views = std::move(scene.views);
  return subject;
}

BenchmarkSubject trained_subject(const BenchCommand& command) {
  OpenedModel opened = open_model(command.model, command.iteration);
  // A bare model does not say which views were held out; the usual rule is assumed.
  if (!opened.run) opened.config.dataset.eval = true;
  BenchmarkSubject subject;
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

BenchmarkSubject subject_of(const BenchCommand& command) {
  const bool is_generated = command.gaussians > 0;
  if (is_generated == !command.model.empty())
    throw UsageError(
        "give one of these to time: a run's folder, a model with --data SCENE, or --gaussians N "
        "for a generated scene");
  if (is_generated && (command.has("dataset.source") || command.has("dataset.resolution")))
    throw UsageError(
        "--data and -r are for a run or a model; with --gaussians use --width and --height");
  return is_generated ? generated_subject(command) : trained_subject(command);
}

BenchmarkReport measure(const BenchmarkSubject& subject, const BenchCommand& command) {
  const BenchmarkPlan& plan = command.plan;
  const std::unique_ptr<Backend> backend = make_training_backend(subject.config.train);
  BenchmarkReport report;
  report.device = backend->name();
  {
    TrainingModel model =
        benchmark_model(*backend, subject.gaussians, subject.config.optimizer.moments);
    report.workload = mean_workload(*backend, model, subject.train_views, subject.settings);
    log_info("timing training: {} warm-up steps, then {} steps twice", plan.warmup, plan.steps);
    report.training = time_training(*backend, model, subject.train_views, subject.settings,
                                    subject.config, plan, report.workload);
    report.peak_gpu_bytes = peak_gpu_bytes(*backend);
    report.forecast_gpu_bytes = forecast_gpu_bytes(model, subject.train_views, subject.settings,
                                                   subject.config, report.workload);
    for (const double scale : plan.scales) {
      log_info("timing rendering: {} views, {} frames each, at scale {:g}",
               subject.rendered_views().size(), 2 * plan.frames + 1, scale);
      const std::vector<View>& views = subject.rendered_views();
      report.rendering.push_back(time_rendering(*backend, model, views, subject.settings, plan,
                                                scale, FrameSource::packed));
    }
  }
  report.clock_mhz = backend->device().clock_mhz();
  log_info("timing copies in memory");
  report.copy_gb_per_second = copy_gb_per_second(*backend);  // last, because it takes memory itself
  return report;
}

void bench(const BenchCommand& command) {
  setup_log(command.verbosity());
  std::optional<OutputLock> lock;
  if (!command.output.empty()) lock.emplace(OutputLock::of_file(command.output));
  const std::vector<OtherReport> others =
      read_reports({command.against.begin(), command.against.end()});
  const BenchmarkSubject subject = subject_of(command);
  check_scales(subject.rendered_views(), command.plan.scales);
  const BenchmarkReport report = measure(subject, command);
  const std::string json = report_json(subject, command.plan, report);
  if (!command.output.empty()) {
    keep_older_aside(command.output);
    write_text(command.output, json);
  }
  std::cout << (command.json ? json : report_text(subject, command.plan, report));
  if (!others.empty() && !command.json)
    std::cout << "\n" << comparison_text({"this call", Json::parse(json)}, others);
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
  verb.add_option("model", command->model,
                  "a run's folder, or with --data a model in any format that gemsplat reads")
      ->type_name("RUN|MODEL");
  verb.add_option("--iteration", command->iteration,
                  "which model of a run: the one saved after this step [the newest]")
      ->type_name("STEP");
  verb.add_flag("--json", command->json, "print JSON");
  verb.add_option("-o,--output", command->output, "also write the JSON to a file")
      ->type_name("FILE");
  verb.add_option("--against", command->against,
                  "also print one table of these figures and those of other reports (-o), with "
                  "what each includes")
      ->delimiter(',')
      ->type_name("FILE,...");
  add_generator_options(verb, *command);
  add_plan_options(verb, command->plan);
  add_dataset_options(verb, *command, "-d,--data,-s,--source-path");
  add_render_options(verb, *command);
  add_general_options(verb, *command);
  verb.callback([command] { bench(*command); });
}

}  // namespace gs
