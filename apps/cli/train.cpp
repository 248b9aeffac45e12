// SPDX-License-Identifier: Apache-2.0
// gemsplat train: the words and flags around a TrainSession, and what it shows on a terminal.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <optional>

#include "apps/cli/devices.h"
#include "apps/cli/foreign_flags.h"
#include "apps/cli/options.h"
#include "apps/cli/reconstruct.h"
#include "apps/cli/verbs.h"
#include "gs_app/run/make_backend.h"
#include "gs_app/run/text.h"
#include "gs_app/session/train_session.h"
#include "gs_app/view/train_viewer.h"
#include "gs_core/error.h"
#include "gs_core/system/processes/process.h"
#include "gs_core/system/processes/signals.h"
#include "gs_model/formats/formats.h"

namespace gs {
namespace {

struct TrainCommand : CommandLine {
  bool print_config = false, force = false;
  std::string resume;                // auto, or the folder or checkpoint of a run; empty: a new run
  int added_steps = 0;               // --iterations +N
  std::vector<std::string> exports;  // names of formats
  ViewerOptions viewer;
  std::string gpus;  // how many, or all; empty: as the settings say
};

// A new run starts from the defaults, which have no output.
Config settings_of(const TrainCommand& command, const Config& start = {}) {
  Config config = resolve(command, start);
  if (!command.gpus.empty()) take_gpus(command.gpus, start.model.output.empty(), config.train);
  return config;
}

// Of one of several processes. As with --gpus, a new run takes as many photos for an update as there
// are GPUs, if no other batch is asked for.
Config settings_of(const TrainCommand& command, const std::optional<ProcessPlace>& place,
                   const Config& start) {
  Config config = settings_of(command, start);
  const bool is_new = start.model.output.empty();
  if (place && is_new && config.train.batch <= config.train.ranks)
    config.train.batch = std::min(config.train.ranks * place->count, kMostBatch);
  return config;
}

void add_viewer_options(CLI::App& verb, ViewerOptions& options) {
  const char* const group = "Viewer";
  verb.add_flag("--viewer", options.is_wanted, "show the run in a browser while it trains")
      ->group(group);
  add_http_place(verb, options.place, "--viewer-", group);
  verb.add_flag("--viewer-wait", options.waits,
                "keep showing the model after the run has ended, until Ctrl-C")
      ->group(group);
  for (const char* option : {"--viewer-host", "--viewer-port", "--viewer-wait"})
    verb.get_option(option)->needs("--viewer");
}

// Progress bars for the parts of a session, and the viewer.
class TerminalHooks final : public SessionHooks {
 public:
  /// The viewer is made here, and lives with the caller: it looks at the session's scene.
  TerminalHooks(const TrainCommand& command, std::optional<TrainViewer>& viewer)
      : command_(command), viewer_(viewer), colmap_(!command.quiet) {}

  void show_colmap(ColmapStage stage, std::int64_t done, std::int64_t total) override {
    colmap_(stage, done, total);
  }
  void show_loading(LoadStage stage, std::size_t done, std::size_t total) override {
    const bool is_refining = stage == LoadStage::refinement;
    show(is_refining                   ? "refining cameras"
         : stage == LoadStage::headers ? "photos found"
                                       : "photos read",
         is_refining ? "step" : "photo", done, total);
  }
  void show_evaluation(std::size_t done, std::size_t total) override {
    show(has_test_ ? "test and training views" : "training views", "view", done, total);
  }
  void before_writing(const RunFolder& folder, const Scene& scene, const Config& config) override {
    words_.reset();
    has_test_ = !scene.test_views.empty();
    if (command_.viewer.is_wanted) viewer_.emplace(folder, scene, config, command_.viewer);
  }
  void before_training(Trainer& trainer, const MetricsObserver& metrics,
                       const EvaluationObserver& evaluations) override {
    if (viewer_) viewer_->watch(trainer, metrics, evaluations);
  }

 private:
  // A bar for each part, until the part is complete.
  void show(const std::string& part, const char* unit, std::size_t done, std::size_t total) {
    if (!bar_ || part != part_) bar_.emplace(std::int64_t(total), !command_.quiet);
    part_ = part;
    if (bar_->due(std::int64_t(done))) bar_->draw(std::int64_t(done), part, unit);
    if (done == total) bar_.reset();  // before the log goes on
  }

  const TrainCommand& command_;
  std::optional<TrainViewer>& viewer_;
  ColmapBar colmap_;
  std::optional<LastWords> words_{std::in_place,
                                  "\nstopped before the first step: nothing was trained\n"};
  bool has_test_ = false;
  std::optional<ProgressBar> bar_;
  std::string part_;
};

void print_summary(const Results& results, const RunFolder& folder) {
  const bool has_test = !results.test.views.empty();
  const Evaluation& shown = has_test ? results.test : results.train;
  const std::string quality =
      shown.views.empty()
          ? "quality:    not measured; --eval holds photos out and measures on them"
          : fmt::format("{} views: {}", has_test ? "test" : "training", summary(shown));
  std::cout << quality << "\n"
            << fmt::format("{} Gaussians, {} steps in {:.1f} s on {}\n",
                           with_commas(results.num_gaussians), results.iterations,
                           results.train_seconds, results.device)
            << fmt::format("model:      {}\n", folder.ply(results.iterations).string())
            << fmt::format("comparison: {}\n", folder.comparison().string())
            << fmt::format("figures:    {}, {}\n", folder.results().string(),
                           folder.metrics().string());
  if (std::filesystem::exists(folder.report()))
    std::cout << fmt::format("report:     {}\n", folder.report().string());
  if (can_view())
    std::cout << fmt::format("look at it: gemsplat view {}\n", shell_word(folder.root().string()));
}

[[noreturn]] void say_stopped(TrainSession& session) {
  const int last = session.trainer().step();
  throw Error(
      fmt::format("stopped after step {} of {}; the model is in {}, and --resume goes on "
                  "from {}",
                  last, session.trainer().schedule().steps(), session.folder().ply(last).string(),
                  session.folder().checkpoints().string()),
      ExitCode::interrupted);
}

TrainRequest request_of(const TrainCommand& command, const std::optional<ProcessPlace>& place) {
  TrainRequest request;
  request.settings = [&command, place](const Config& start) {
    return settings_of(command, place, start);
  };
  request.place = place;
  request.begin = process_begin();
  request.resume = command.resume;
  request.added_steps = command.added_steps;
  request.force = command.force;
  request.exports = command.exports;
  request.shows_progress = !command.quiet;
  return request;
}

// Process 0 talks for all. Signals, which srun and mpirun send to all, are for it: the others go on
// with it as long as it takes steps.
void follow(const TrainCommand& command, const ProcessPlace& place) {
  setup_log(Verbosity::quiet);
  const SignalCount passed_over;
  SessionHooks hooks;
  TrainSession(request_of(command, place), hooks).run();
}

void train(const TrainCommand& command) {
  const std::optional<ProcessPlace> place = process_place();
  if (place && place->rank > 0 && !command.print_config) return follow(command, *place);
  setup_log(command.verbosity());
  if (command.viewer.is_wanted) check_can_view();
  std::optional<TrainViewer> viewer;
  TerminalHooks hooks(command, viewer);
  TrainSession session(request_of(command, place), hooks);
  const struct EndViewer {  // before the session, whose scene it shows
    std::optional<TrainViewer>& viewer;
    ~EndViewer() { viewer.reset(); }
  } end_viewer{viewer};
  if (command.print_config) {
    std::cout << to_toml(settings_of(command));
    return;
  }
  const SessionEnd end = session.run();
  if (end == SessionEnd::nothing_left) return;
  if (end == SessionEnd::stopped) {
    if (viewer) viewer->end_stopped(session.trainer());
    say_stopped(session);
  }
  if (!command.quiet) print_summary(session.results(), session.folder());
  if (viewer) viewer->end(session.trainer(), session.results().test);
}

}  // namespace

void add_train(CLI::App& program) {
  CLI::App& verb = *program.add_subcommand(
      "train", "Train Gaussians on a scene, or on photos alone, which COLMAP places first");
  const auto command = std::make_shared<TrainCommand>();
  CommandLine& line = *command;
  add_dataset_options(verb, line, "scene,-s,--source-path,-d,--data");
  add_setting(verb, line, "--eval", "dataset.eval", "Scene");
  add_setting(verb, line, "--refine-cameras", "dataset.refine_cameras", "Scene");
  add_setting(verb, line, "--exposure", "dataset.exposure", "Scene");
  add_setting(verb, line, "-o,--output,-m,--model-path", "model.output", "Output");
  verb.add_option("--resume", command->resume,
                  "continue the run in OUT, or start it if there is none (auto); or continue the "
                  "run of this folder or checkpoint")
      ->type_name("auto|PATH")
      ->expected(0, 1)
      ->default_str("auto")
      ->group("Output");
  add_setting(verb, line, "--from,--start-from", "model.start_from", "Training");
  add_setting(verb, line, "--filter-3d", "model.filter_3d", "Training");
  add_setting(verb, line, "--checkpoint-every", "train.checkpoint_every", "Output");
  verb.add_flag("--force", command->force, "if OUT holds a run, move it to OUT.bak-N first")
      ->group("Output");
  verb.add_option("--export", command->exports,
                  "also write the final model in these formats: " + format_names())
      ->delimiter(',')
      ->type_name("FORMAT,...")
      ->group("Output");
  add_viewer_options(verb, command->viewer);
  add_setting(verb, line, "--save-steps,--save-iterations", "train.save_steps", "Output",
              "also save the PLY after these steps");
  add_setting(verb, line, "--test-steps,--test-iterations,--eval-steps", "train.test_steps",
              "Output", "also evaluate the test views after these steps");
  add_setting(verb, line, "--lpips", "eval.lpips", "Output",
              "at the end also measure LPIPS, with the weights in this file");
  add_setting(verb, line, "-i,--iterations,--iter,--max-steps", "train.iterations", "Training",
              "number of training steps, one photo each; the schedule scales with it; 0: by the "
              "number of photos; +N: N more steps of a finished run, with --resume");
  add_setting(verb, line, "--steps-scaler", "train.steps_scaler", "Training");
  add_setting(verb, line, "--strategy", "density.strategy", "Training");
  add_setting(verb, line, "--max-gaussians,--max-cap,--cap-max", "density.max_gaussians",
              "Training", "largest number of Gaussians; auto: the number that fits into memory");
  verb.add_option("--gpus", command->gpus,
                  "number of GPUs to train on, or all; a new run updates by the same number of "
                  "photos at once (docs/guide/several_gpus.md)")
      ->type_name("N|all")
      ->group("Training");
  add_setting(verb, line, "--seed", "train.seed", "Training");
  add_setting(verb, line, "--deterministic", "train.deterministic", "Training");
  add_render_options(verb, line);
  add_general_options(verb, line);
  add_foreign_flags(verb, line, "model.");
  add_foreign_flags(verb, line, "loss.");
  verb.add_flag("--print-config", command->print_config,
                "print all settings as TOML, and do nothing else")
      ->group("Settings");
  verb.callback([command] {
    command->added_steps = extract_added_steps(command->flags);
    if (command->added_steps && command->resume.empty())
      throw UsageError("--iterations +N extends a finished run: name it with --resume");
    train(*command);
  });
}

}  // namespace gs
