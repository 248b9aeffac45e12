// SPDX-License-Identifier: Apache-2.0
// gemsplat train: a TrainSession, and what it shows on a terminal and in the browser.
#include <spdlog/fmt/fmt.h>

#include <optional>

#include "gs_app/checkpoints/resume.h"
#include "gs_app/jobs/parts/colmap_progress.h"
#include "gs_app/jobs/parts/foreign_flags.h"
#include "gs_app/jobs/parts/shared_options.h"
#include "gs_app/jobs/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/output_place.h"
#include "gs_app/run/text.h"
#include "gs_app/run/wall_clock.h"
#include "gs_app/session/train_session.h"
#include "gs_app/view/train_viewer.h"
#include "gs_core/system/processes/signals.h"
#include "gs_core/system/text/read_json.h"
#include "gs_model/formats/formats.h"

namespace gs {
namespace {

struct TrainJob : JobSettings {
  bool print_config = false, force = false;
  std::string resume;                // auto, or the folder or checkpoint of a run; empty: a new run
  int added_steps = 0;               // --iterations +N
  std::vector<std::string> exports;  // names of formats
  ViewerOptions viewer;
  std::string gpus;  // how many, or all; empty: as the settings say
};

void visit_viewer(ViewerOptions& viewer, OptionList& option) {
  const char* const group = "Viewer";
  option("--viewer", viewer.is_wanted, "show the run in a browser while it trains").group(group);
  http_options(option, viewer.place, "--viewer-", group);
  option("--viewer-wait", viewer.waits,
         "keep showing the model after the run has ended, until Ctrl-C")
      .group(group)
      .rare();
  for (const char* name : {"--viewer-host", "--viewer-port", "--viewer-wait"})
    option.get(name).needs("--viewer");
}

void visit_output(TrainJob& job, OptionList& option) {
  const char* const group = "Output";
  option.setting("-o,--output,-m,--model-path", "model.output", group,
                 "folder of the run [beside the scene: SCENE-run]");
  option("--resume", job.resume,
         "continue the run in OUT, or start it if there is none (auto); or continue the run of "
         "this folder or checkpoint")
      .takes("auto|PATH")
      .suggests({"auto"})
      .alone("auto")
      .group(group);
  option.setting("--checkpoint-every", "train.checkpoint_every", group).rare();
  option("--force", job.force, "if OUT holds a run, move it to OUT.bak-N first").group(group);
  option("--export", job.exports, "also write the final model in these formats: " + format_names())
      .takes("FORMAT,...")
      .commas()
      .group(group);
  option
      .setting("--save-steps,--save-iterations", "train.save_steps", group,
               "also save the PLY after these steps")
      .rare();
  option
      .setting("--test-steps,--test-iterations,--eval-steps", "train.test_steps", group,
               "also evaluate the test views after these steps")
      .rare();
  option
      .setting("--lpips", "eval.lpips", group,
               "at the end also measure LPIPS, with the weights in this file")
      .rare();
}

void visit_training(TrainJob& job, OptionList& option) {
  const char* const group = "Training";
  option.setting("-i,--iterations,--iter,--max-steps", "train.iterations", group,
                 "number of training steps, one photo each; the schedule scales with it; 0: by the "
                 "number of photos; +N: N more steps of a finished run, with --resume");
  option.setting("--max-gaussians,--max-cap,--cap-max", "density.max_gaussians", group,
                 "largest number of Gaussians; auto: the number that fits into memory");
  option.setting("--from,--start-from", "model.start_from", group);
  option.setting("--filter-3d", "model.filter_3d", group).rare();
  option.setting("--steps-scaler", "train.steps_scaler", group).rare();
  option.setting("--strategy", "density.strategy", group).rare();
  option("--gpus", job.gpus,
         "number of GPUs to train on, or all; a new run updates by the same number of photos at "
         "once (docs/guide/several_gpus.md)")
      .takes("N|all")
      .suggests({"all"})
      .group(group)
      .rare();
  option.setting("--seed", "train.seed", group).rare();
  option.setting("--deterministic", "train.deterministic", group).rare();
}

void visit_options(TrainJob& job, OptionList& option) {
  dataset_options(option, "scene,-s,--source-path,-d,--data");
  option.setting("--eval", "dataset.eval", "Scene");
  option.setting("--refine-cameras", "dataset.refine_cameras", "Scene").rare();
  option.setting("--exposure", "dataset.exposure", "Scene").rare();
  visit_output(job, option);
  visit_training(job, option);
  visit_viewer(job.viewer, option);
  render_options(option);
  general_options(option);
  foreign_options(option, "model.");
  foreign_options(option, "loss.");
  option("--print-config", job.print_config, "print all settings as TOML, and do nothing else")
      .group("Settings")
      .rare();
}

// A new run starts from the defaults, which have no output.
Config settings_of(const TrainJob& job, const Config& start = {}) {
  Config config = resolve(job, start);
  if (!job.gpus.empty()) take_gpus(job.gpus, start.model.output.empty(), config.train);
  return config;
}

// Of one of several processes. As with --gpus, a new run takes as many photos for an update as there
// are GPUs, if no other batch is asked for.
Config settings_of(const TrainJob& job, const std::optional<ProcessPlace>& place,
                   const Config& start) {
  Config config = settings_of(job, start);
  const bool is_new = start.model.output.empty();
  if (place && is_new && config.train.batch <= config.train.ranks)
    config.train.batch = std::min(config.train.ranks * place->count, kMostBatch);
  if (config.model.output.empty() && !config.dataset.source.empty())
    config.model.output = beside(config.dataset.source, "-run").string();
  return config;
}

// Progress for the parts of a session, and the viewer.
class JobHooks final : public SessionHooks {
 public:
  /// The viewer is made here, and lives with the caller: it looks at the session's scene.
  JobHooks(const TrainJob& job, std::optional<TrainViewer>& viewer, JobEvents& events)
      : job_(job), viewer_(viewer), events_(events), colmap_(events) {}

  void show_colmap(ColmapStage stage, std::int64_t done, std::int64_t total) override {
    colmap_(stage, done, total);
  }
  void show_loading(LoadStage stage, std::size_t done, std::size_t total) override {
    const bool is_refining = stage == LoadStage::refinement;
    events_.progress(is_refining                   ? "refining cameras"
                     : stage == LoadStage::headers ? "photos found"
                                                   : "photos read",
                     is_refining ? "step" : "photo", done, total);
  }
  void show_evaluation(std::size_t done, std::size_t total) override {
    events_.progress(has_test_ ? "test and training views" : "training views", "view", done, total);
  }
  void before_writing(const RunFolder& folder, const Scene& scene, const Config& config) override {
    words_.reset();
    has_test_ = !scene.test_views.empty();
    if (job_.viewer.is_wanted) viewer_.emplace(folder, scene, config, job_.viewer);
  }
  void before_training(Trainer& trainer, const MetricsObserver& metrics,
                       const EvaluationObserver& evaluations) override {
    if (viewer_) viewer_->watch(trainer, metrics, evaluations);
  }

 private:
  const TrainJob& job_;
  std::optional<TrainViewer>& viewer_;
  JobEvents& events_;
  ColmapEvents colmap_;
  std::optional<LastWords> words_{std::in_place,
                                  "\nstopped before the first step: nothing was trained\n"};
  bool has_test_ = false;
};

std::string text_of(const Results& results, const RunFolder& folder) {
  const bool has_test = !results.test.views.empty();
  const Evaluation& shown = has_test ? results.test : results.train;
  std::string text =
      (shown.views.empty()
           ? "quality:    not measured; --eval holds photos out and measures on them\n"
           : fmt::format("{} views: {}\n", has_test ? "test" : "training", summary(shown))) +
      fmt::format("{} Gaussians, {} steps in {:.1f} s on {}\n", with_commas(results.num_gaussians),
                  results.iterations, results.train_seconds, results.device) +
      fmt::format("model:      {}\n", folder.ply(results.iterations).string()) +
      fmt::format("comparison: {}\n", folder.comparison().string()) +
      fmt::format("figures:    {}, {}\n", folder.results().string(), folder.metrics().string());
  if (std::filesystem::exists(folder.report()))
    text += fmt::format("report:     {}\n", folder.report().string());
  return text;
}

// The folder, and its results.json where the run is finished.
Outcome outcome_of(const RunFolder& folder, std::string text) {
  const std::string root = folder.root().string();
  Outcome outcome{std::move(text), {{"folder", root}}};
  if (std::filesystem::exists(folder.results()))
    outcome.json["results"] = read_json(folder.results());
  outcome.next = {can_view() ? NextCommand{"look at it", "gemsplat view " + shell_word(root)}
                             : NextCommand{"pictures", "gemsplat render " + shell_word(root)}};
  return outcome;
}

[[noreturn]] void say_stopped(TrainSession& session) {
  const int last = session.trainer().step();
  throw Error(
      fmt::format("stopped after step {} of {}; the model is in {} (look at it: gemsplat view {}), "
                  "and --resume goes on from {}",
                  last, session.trainer().schedule().steps(), session.folder().ply(last).string(),
                  shell_word(session.folder().root().string()),
                  session.folder().checkpoints().string()),
      ExitCode::interrupted);
}

TrainRequest request_of(const TrainJob& job, const std::optional<ProcessPlace>& place) {
  TrainRequest request;
  request.settings = [&job, place, is_said = std::make_shared<bool>(false)](const Config& start) {
    Config config = settings_of(job, place, start);
    const bool is_default = start.model.output.empty() && resolve(job, start).model.output.empty();
    if (is_default && !config.model.output.empty() && !std::exchange(*is_said, true))
      say_place(config.model.output);
    return config;
  };
  request.place = place;
  request.begin = process_begin();
  request.resume = job.resume;
  request.added_steps = job.added_steps;
  request.force = job.force;
  request.exports = job.exports;
  request.shows_progress = !job.quiet;
  return request;
}

// Process 0 talks for all. Signals, which srun and mpirun send to all, are for it: the others go on
// with it as long as it takes steps.
Outcome follow(const TrainJob& job, const ProcessPlace& place) {
  setup_log(Verbosity::quiet);
  const SignalCount passed_over;
  SessionHooks hooks;
  TrainSession(request_of(job, place), hooks).run();
  return {};
}

Outcome train(const TrainJob& job, JobEvents& events) {
  const std::optional<ProcessPlace> place = process_place();
  if (place && place->rank > 0 && !job.print_config) return follow(job, *place);
  if (job.viewer.is_wanted) check_can_view();
  std::optional<TrainViewer> viewer;
  JobHooks hooks(job, viewer, events);
  TrainSession session(request_of(job, place), hooks);
  const struct EndViewer {  // before the session, whose scene it shows
    std::optional<TrainViewer>& viewer;
    ~EndViewer() { viewer.reset(); }
  } end_viewer{viewer};
  if (job.print_config)
    return {to_toml(settings_of(job)),
            nullptr,
            {{"train with these", "gemsplat train SCENE -c FILE"}},
            true};
  const SessionEnd end = session.run();
  if (end == SessionEnd::nothing_left) return outcome_of(session.folder(), "");
  if (end == SessionEnd::stopped) {
    if (viewer) viewer->end_stopped(session.trainer());
    say_stopped(session);
  }
  Outcome outcome = outcome_of(session.folder(), text_of(session.results(), session.folder()));
  if (!viewer) return outcome;
  events.say(std::exchange(outcome.text, ""));  // before the wait for a signal
  viewer->end(session.trainer(), session.results().test);
  return outcome;
}

Outcome run(TrainJob job, JobEvents& events) {
  job.added_steps = extract_added_steps(job.flags);
  if (job.added_steps && job.resume.empty())
    throw UsageError("--iterations +N extends a finished run: name it with --resume");
  return train(job, events);
}

}  // namespace

Verb train_verb() {
  return verb_of<TrainJob>(
      "train", VerbGroup::train,
      "Train Gaussians on a scene, or on photos alone, which COLMAP places first",
      {"train scene -o out/scene --eval", "train photos", "train scene -o out/scene --resume"});
}

}  // namespace gs
