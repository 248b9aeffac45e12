// SPDX-License-Identifier: Apache-2.0
// gemsplat bench: times training and rendering of a trained or a generated model on one device.
#include <spdlog/fmt/fmt.h>

#include <filesystem>

#include "data_loaders/scene/load_scene.h"
#include "gs_app/checks/benchmark_comparison.h"
#include "gs_app/checks/benchmark_report.h"
#include "gs_app/checks/generated_scene.h"
#include "gs_app/export/export_model.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/open_model.h"
#include "gs_app/run/results.h"
#include "gs_app/run/text.h"
#include "gs_core/math/constants.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_render/render_settings.h"

namespace gs {
namespace {

constexpr int kMostGaussians = 100'000'000, kMostViews = 1000, kMostRuns = 1'000'000;

struct BenchJob : JobSettings {
  std::string model, output;
  std::optional<int> step;
  int gaussians = 0;  // of a generated scene; 0 for a trained model
  int width = 1280, height = 720, views = 8;
  BenchmarkPlan plan;
  std::vector<std::string> against;
};

void visit_generator(BenchJob& job, OptionList& option) {
  const auto add = [&](const char* name, int& value, int most, const char* meaning) -> Option& {
    return option(name, value, meaning).takes("N").between(1, most).group("Generated scene");
  };
  add("--gaussians", job.gaussians, kMostGaussians,
      "time a generated scene with this many random Gaussians");
  add("--width", job.width, kMaxPictureSide, "width of its views in pixels [1280]");
  add("--height", job.height, kMaxPictureSide, "height of its views in pixels [720]");
  add("--views", job.views, kMostViews, "number of its views [8]").rare();
}

void visit_plan(BenchmarkPlan& plan, OptionList& option) {
  const auto add = [&](const char* name, int& value, int least, const char* meaning) -> Option& {
    return option(name, value, meaning).takes("N").between(least, kMostRuns).group("Measuring");
  };
  add("--steps", plan.steps, 1, "timed training steps [200]");
  add("--warmup", plan.warmup, 0, "untimed training steps before them [50]").rare();
  add("--frames", plan.frames, 1, "timed frames of each view, after one untimed frame [5]");
  option("--scales", plan.scales, "sizes of rendered pictures, as multiples of the views' size [1]")
      .takes("X,...")
      .between(0.01, 100)
      .commas()
      .group("Measuring")
      .rare();
}

void visit_options(BenchJob& job, OptionList& option) {
  option("model", job.model,
         "a run's folder, or with --data a model in any format that gemsplat reads")
      .takes("RUN|MODEL");
  option("--iteration", job.step,
         "which model of a run: the one saved after this step [the newest]")
      .takes("STEP")
      .rare();
  option("-o,--output", job.output, "also write the JSON to a file").takes("FILE");
  option("--against", job.against,
         "also print one table of these figures and those of other reports (-o), with what each "
         "includes")
      .takes("FILE,...")
      .commas();
  visit_generator(job, option);
  visit_plan(job.plan, option);
  dataset_options(option, "-d,--data,-s,--source-path");
  render_options(option);
  general_options(option);
}

BenchmarkSubject generated_subject(const BenchJob& job) {
  SceneRecipe recipe;
  recipe.gaussians = std::size_t(job.gaussians);
  recipe.width = job.width;
  recipe.height = job.height;
  recipe.views = job.views;
  BenchmarkSubject subject;
  subject.model = subject.scene = "generated";
  subject.config = resolve_to_work(job);
  subject.settings = render_settings(subject.config);
  GeneratedScene scene = generated_scene(recipe);
  subject.gaussians = std::move(scene.model);
  subject.train_views = std::move(scene.views);
  return subject;
}

BenchmarkSubject trained_subject(const BenchJob& job) {
  OpenedModel opened = open_model(job.model, job.step);
  // A bare model does not say which views were held out; the usual rule is assumed.
  if (!opened.run) opened.config.dataset.eval = true;
  BenchmarkSubject subject;
  subject.config = resolve_to_work(job, opened.config);
  const DatasetConfig& dataset = subject.config.dataset;
  if (dataset.source.empty())
    throw UsageError("the model has no views to time; give its scene with --data SCENE");
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

BenchmarkSubject subject_of(const BenchJob& job) {
  const bool is_generated = job.gaussians > 0;
  if (is_generated == !job.model.empty())
    throw UsageError(
        "give one of these to time: a run's folder, a model with --data SCENE, or --gaussians N "
        "for a generated scene");
  if (is_generated && (job.has("dataset.source") || job.has("dataset.resolution")))
    throw UsageError(
        "--data and -r are for a run or a model; with --gaussians use --width and --height");
  return is_generated ? generated_subject(job) : trained_subject(job);
}

BenchmarkReport measure(const BenchmarkSubject& subject, BenchmarkPlan plan, JobEvents& events) {
  const std::unique_ptr<Backend> backend = make_training_backend(subject.config.train);
  BenchmarkReport report;
  report.device = backend->name();
  {
    TrainingModel model =
        benchmark_model(*backend, subject.gaussians, subject.config.optimizer.moments);
    report.workload = mean_workload(*backend, model, subject.train_views, subject.settings);
    plan.after_run = [&](std::size_t done, std::size_t total) {
      events.progress("training", "step", done, total);
    };
    log_info("timing training: {} warm-up steps, then {} steps twice", plan.warmup, plan.steps);
    report.training = time_training(*backend, model, subject.train_views, subject.settings,
                                    subject.config, plan, report.workload);
    report.peak_gpu_bytes = peak_gpu_bytes(*backend);
    report.forecast_gpu_bytes = forecast_gpu_bytes(model, subject.train_views, subject.settings,
                                                   subject.config, report.workload);
    plan.after_run = [&](std::size_t done, std::size_t total) {
      events.progress("rendering", "frame", done, total);
    };
    for (const double scale : plan.scales) {
      log_info("timing rendering: {} views, {} frames each, at scale {:g}",
               subject.rendered_views().size(), 2 * plan.frames + 1, scale);
      const std::vector<View>& views = subject.rendered_views();
      report.rendering.push_back(
          time_rendering(*backend, model, views, subject.settings, plan, scale));
    }
  }
  report.clock_mhz = backend->device().clock_mhz();
  log_info("timing copies in memory");
  report.copy_gb_per_second = copy_gb_per_second(*backend);  // last, because it takes memory itself
  return report;
}

NextCommand next_of(const BenchJob& job) {
  const std::string subject =
      job.model.empty() ? fmt::format("--gaussians {}", job.gaussians) : shell_word(job.model);
  if (job.output.empty())
    return {"keep such figures", fmt::format("gemsplat bench {} -o before.json", subject)};
  return {"compare a later build with it",
          fmt::format("gemsplat bench {} --against {}", subject, shell_word(job.output))};
}

Outcome run(const BenchJob& job, JobEvents& events) {
  std::optional<OutputLock> lock;
  if (!job.output.empty()) lock.emplace(OutputLock::of_file(job.output));
  const std::vector<OtherReport> others = read_reports({job.against.begin(), job.against.end()});
  const BenchmarkSubject subject = subject_of(job);
  check_scales(subject.rendered_views(), job.plan.scales);
  const BenchmarkReport report = measure(subject, job.plan, events);
  const std::string json = report_json(subject, job.plan, report);
  if (!job.output.empty()) {
    keep_older_aside(job.output);
    write_text(job.output, json);
  }
  Outcome outcome{report_text(subject, job.plan, report), Json::parse(json), {}, true};
  if (!others.empty()) outcome.text += "\n" + comparison_text({"this call", outcome.json}, others);
  outcome.next = {next_of(job)};
  return outcome;
}

}  // namespace

Verb bench_verb() {
  return verb_of<BenchJob>(
      "bench", VerbGroup::compare, "Time training and rendering; on a GPU stage by stage",
      {"bench out/scene", "bench --gaussians 1000000 --width 1600 --height 900",
       "bench out/scene --against before.json"});
}

}  // namespace gs
