// SPDX-License-Identifier: Apache-2.0
// gemsplat train: photos and a COLMAP model in, a run's folder out.
#include <spdlog/fmt/fmt.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <memory>
#include <optional>

#include "apps/cli/devices.h"
#include "apps/cli/options.h"
#include "apps/cli/reconstruct.h"
#include "apps/cli/verbs.h"
#include "data_loaders/doctor/forecast.h"
#include "data_loaders/photos/photos.h"
#include "data_loaders/reconstruct/photo_folder.h"
#include "data_loaders/scene/load_scene.h"
#include "data_loaders/scene/scene_hash.h"
#include "gs_app/export/exported_file.h"
#include "gs_app/pictures/comparison.h"
#include "gs_app/pictures/pictures.h"
#include "gs_app/report/report_run.h"
#include "gs_app/run/checkpoint_folder.h"
#include "gs_app/run/folder_lock.h"
#include "gs_app/run/profile_observer.h"
#include "gs_app/run/results.h"
#include "gs_app/run/resume.h"
#include "gs_app/run/run_folder.h"
#include "gs_app/run/stop_on_signal.h"
#include "gs_app/run/text.h"
#include "gs_app/run/train_observers.h"
#include "gs_app/view/train_viewer.h"
#include "gs_core/error.h"
#include "gs_core/parallel.h"

namespace gs {
namespace {

constexpr std::size_t kComparedViews = 4;    // rows of comparison.png

struct TrainCommand : CommandLine {
  bool print_config = false, force = false;
  std::string resume;   // auto, or the folder or checkpoint of a run; empty: not at all
  int added_steps = 0;  // --iterations +N
  std::vector<std::string> exports;  // names of formats
  ViewerOptions viewer;
};

void add_viewer_options(CLI::App& verb, ViewerOptions& options) {
  const char* const group = "Viewer";
  verb.add_flag("--viewer", options.is_wanted, "show the run in a browser while it goes on")
      ->group(group);
  add_http_place(verb, options.place, "--viewer-", group);
  verb.add_flag("--viewer-wait", options.waits,
                "go on showing the model after the end, until Ctrl-C")
      ->group(group);
  for (const char* option : {"--viewer-host", "--viewer-port", "--viewer-wait"})
    verb.get_option(option)->needs("--viewer");
}

// The config of this run, with the scene's absolute path, so that its folder can be used from anywhere.
Config resolve_run(const TrainCommand& command) {
  Config config = resolve(command);
  if (command.print_config) return config;
  if (config.dataset.source.empty())
    throw UsageError("which scene? give its folder: gemsplat train SCENE -o OUT");
  if (config.model.output.empty())
    throw UsageError("where to? give the folder of the run with -o OUT");
  config.dataset.source =
      std::filesystem::absolute(config.dataset.source).lexically_normal().string();
  return config;
}

// Masks stay where they are when photos become a scene elsewhere.
void keep_masks(DatasetConfig& dataset, const std::filesystem::path& scene) {
  const bool is_named = !dataset.masks.empty();
  const auto masks = std::filesystem::path(dataset.source) / (is_named ? dataset.masks : "masks");
  if (dataset.masks != "none" && (is_named || std::filesystem::is_directory(masks)))
    dataset.masks = masks.string();
  dataset.source = scene.string();
}

// A folder of photos alone, or a video, becomes a scene first, in OUT/scene, and that is trained on.
void reconstruct_bare_photos(Config& config, const RunFolder& folder, bool show_progress) {
  DatasetConfig& dataset = config.dataset;
  const bool places_are_named = !dataset.model.empty() || dataset.images != DatasetConfig{}.images;
  if (places_are_named || !holds_only_photos(dataset.source)) return;
  log_info("{} holds pictures and no camera poses: COLMAP looks for them first", dataset.source);
  make_run_folder(folder);  // before the scene: an older run is moved away without it
  const auto scene = std::filesystem::absolute(folder.root() / "scene").lexically_normal();
  const Reconstruction result =
      run_colmap({dataset.source, scene, config.reconstruct, config.train.threads, false},
                 ColmapBar(show_progress));
  log_info("{}", describe(result));
  keep_masks(dataset, scene);
}

Scene load(const DatasetConfig& dataset, bool show_progress) {
  std::unique_ptr<ProgressBar> bar;
  LoadStage shown{};
  const auto show = [&](LoadStage stage, std::size_t done, std::size_t total) {
    if (!bar || stage != shown)
      bar = std::make_unique<ProgressBar>(std::int64_t(total), show_progress);
    shown = stage;
    const bool is_refining = stage == LoadStage::refinement;
    const char* const what = is_refining                   ? "refining cameras"
                             : stage == LoadStage::headers ? "photos found"
                                                           : "photos read";
    if (bar->due(std::int64_t(done)))
      bar->draw(std::int64_t(done), what, is_refining ? "step" : "photo");
    if (done == total) bar.reset();  // before the log goes on
  };
  Scene scene = load_scene(dataset, show);
  bar.reset();
  const View& first = scene.train_views.empty() ? scene.test_views.at(0) : scene.train_views[0];
  log_info("{}: {} views to train on, {} held out, {}x{} pixels; {} points, extent {:.3g}",
           scene.source, scene.train_views.size(), scene.test_views.size(), first.camera.width,
           first.camera.height, with_commas(scene.points.size()), scene.extent);
  return scene;
}

// Some of the views, evenly chosen.
std::vector<View> sample_of(const std::vector<View>& views, std::size_t wanted) {
  std::vector<View> sample;
  for (const std::size_t index : evenly_chosen(views.size(), wanted))
    sample.push_back(views[index]);
  return sample;
}

// The evaluation at the end, with its pictures: test/ours_N/{renders,gt}, or train/ where nothing was held out, and
// comparison.png.
void evaluate_run(Trainer& trainer, const RunFolder& folder, int step, Results& results) {
  const Scene& scene = trainer.scene();
  const bool has_test = !scene.test_views.empty();
  const Vec3f background = trainer.evaluation_settings().background;
  std::vector<Comparison> comparisons;
  const auto compare_some_of = [&](const std::vector<View>& views) {
    return [&comparisons, background, chosen = evenly_chosen(views.size(), kComparedViews)](
               std::size_t index, const View& view, const Image8& render) {
      if (std::binary_search(chosen.begin(), chosen.end(), index))
        comparisons.push_back({shown_photo(view, background), render});
    };
  };
  const auto compare_test = compare_some_of(scene.test_views);
  const auto keep_pictures = [&](const char* split, std::size_t index, const View& view,
                                 const Image8& render) {
    const std::string name = picture_file(index);
    write_png(folder.pictures(split, step) / "renders" / name, render);
    write_png(folder.pictures(split, step) / "gt" / name, shown_photo(view, background));
  };
  results.test = evaluate(trainer.backend().renderer(), trainer.model().gaussians.span(),
                          scene.test_views, trainer.evaluation_settings(),
                          [&](std::size_t index, const View& view, const ImageF& image) {
                            const Image8 render = to_image8(image);
                            keep_pictures("test", index, view, render);
                            compare_test(index, view, render);
                          });

  results.train =
      evaluate(trainer.backend().renderer(), trainer.model().gaussians.span(),
               sample_of(scene.train_views, kTrainViewsShown), trainer.evaluation_settings(),
               [&](std::size_t index, const View& view, const ImageF& image) {
                 if (has_test) return;
                 const Image8 render = to_image8(image);
                 keep_pictures("train", index, view, render);
                 if (comparisons.size() < kComparedViews)
                   comparisons.push_back({shown_photo(view, background), render});
               });
  if (!comparisons.empty()) write_png(folder.comparison(), comparison_picture(comparisons));
}

void print_summary(const Results& results, const RunFolder& folder) {
  const bool has_test = !results.test.views.empty();
  std::cout << fmt::format("{} views: {}\n", has_test ? "test" : "training",
                           summary(has_test ? results.test : results.train))
            << fmt::format("{} Gaussians, {} steps in {:.1f} s on {}\n",
                           with_commas(results.num_gaussians), results.iterations,
                           results.train_seconds, results.device)
            << fmt::format("model:      {}\n", folder.ply(results.iterations).string())
            << fmt::format("comparison: {}\n", folder.comparison().string())
            << fmt::format("figures:    {}, {}\n", folder.results().string(),
                           folder.metrics().string());
  if (std::filesystem::exists(folder.report()))
    std::cout << fmt::format("report:     {}\n", folder.report().string());
}

void log_forecast(const Config& config, const Scene& scene, Backend& backend) {
  SceneSize size;
  size.points = scene.points.size();
  for (const std::vector<View>* views : {&scene.train_views, &scene.test_views})
    for (const View& view : *views) {
      size.photo_bytes += double(photo_bytes(view));
      if (!view.source) size.loaded_bytes += double(photo_bytes(view));
      size.megapixels += 1e-6 * double(view.camera.width) * double(view.camera.height);
    }
  size.megapixels /= double(scene.train_views.size() + scene.test_views.size());
  const Forecast run = forecast(config, size, forecast_device(backend));
  log_info("forecast: {}", run.text);
  for (const std::string& warning : run.warnings) log_warning("{}", warning);
}

// The folder that the run is written to, and what is known before the first step in it.
void start_folder(const TrainCommand& command, const std::optional<ResumedRun>& resumed,
                  const RunFolder& folder, const Config& config, const Scene& scene) {
  if (resumed && resumed->goes_on_in_place()) {
    prepare_folder(folder, *resumed);
    if (holds_text(folder.config(), to_toml(config))) return;  // as all the rest
  } else if (!resumed && !command.resume.empty()) {
    prepare_fresh_start(folder, config);
  } else {
    make_run_folder(folder);
  }
  write_run_description(folder, config, scene);
}

// The whole run; until a signal stops it, or memory runs out for good.
void run_until_done(Trainer& trainer, const RunFolder& folder) {
  StopOnSignal stop_on_signal(trainer);
  try {
    trainer.run();
  } catch (const Error& error) {
    const auto kept = checkpoints_in(folder.checkpoints());
    if (error.code() != ExitCode::out_of_memory || kept.empty()) throw;
    throw Error(fmt::format("{}; the run up to step {} is kept in {}: go on with --resume and a "
                            "lower --max-gaussians, or on another machine",
                            error.what(), kept[0].step, kept[0].file.string()),
                error.code());
  }
}

// After a signal: the model as it is, beside the checkpoint that the run can be resumed from.
[[noreturn]] void end_stopped_run(Trainer& trainer, const RunFolder& folder) {
  const int last = trainer.step();
  if (!std::filesystem::exists(folder.ply(last))) save_model(folder, last, trainer);
  throw Error(fmt::format("stopped by a signal after step {} of {}; the model is in {}, and "
                          "--resume goes on from {}",
                          last, trainer.schedule().steps(), folder.ply(last).string(),
                          folder.checkpoints().string()),
              ExitCode::interrupted);
}

Results results_of(Trainer& trainer) {
  const Scene& scene = trainer.scene();
  Results results;
  results.iterations = trainer.step();
  results.num_gaussians = trainer.gaussian_count();
  results.train_seconds = trainer.train_seconds();
  results.device = trainer.backend().name();
  results.seed = trainer.config().train.seed;
  results.world_offset = scene.world_offset;
  results.refinement = scene.refinement;
  results.exposure = scene.exposure;
  results.peak_gpu_bytes = peak_gpu_bytes(trainer.backend());
  results.scene_hash = scene_hash(trainer.config().dataset);
  return results;
}

// Rows of metrics.csv and profile.csv that a resumed run goes on after. The last step's row of the former is written at
// the end, with its results.
struct RowsBefore {
  std::string metrics, profile;
};

RowsBefore rows_before(const std::optional<ResumedRun>& resumed, int steps) {
  if (!resumed) return {};
  const int done = resumed->checkpoint.state.progress.step;
  const RunFolder folder(resumed->source);
  return {metrics_up_to(folder.metrics(), std::min(done, steps - 1)),
          ProfileObserver::rows_up_to(folder.profile(), done)};
}

// Beside the PLY after the last step, in the formats of --export.
void export_run(const TrainCommand& command, Trainer& trainer, const RunFolder& folder) {
  if (command.exports.empty()) return;
  const GaussianModel model = trained_model(trainer);
  Viewpoints viewpoints{
      trainer.backend(), trainer.model().gaussians.span(), trainer.evaluation_settings(), {}};
  const Scene& scene = trainer.scene();
  if (scene.test_views.empty()) viewpoints.what = "training";
  for (const View& view : scene.test_views.empty() ? scene.train_views : scene.test_views)
    viewpoints.cameras.push_back(view.camera);
  for (const std::string& name : command.exports) {
    const ModelFormat& format = format_named(name);
    ExportRequest request{folder.ply(trainer.step()), {}, {}};
    request.file.replace_extension(format.ending);
    if (request.file == folder.ply(trainer.step())) continue;  // is there
    log_info("{}", summary(export_model(model, request, &viewpoints), &viewpoints));
  }
}

void train(const TrainCommand& command) {
  setup_log(command.verbosity());
  if (command.viewer.is_wanted) check_can_view();
  for (const std::string& name : command.exports) format_named(name).require({});
  const auto find_resumed = [&]() -> std::optional<ResumedRun> {
    if (command.resume.empty() || command.print_config) return std::nullopt;
    return find_run([&](const Config& start) { return resolve(command, start); }, command.resume,
                    command.added_steps);
  };
  std::optional<ResumedRun> resumed = find_resumed();
  Config config = resumed ? resumed->config : resolve_run(command);
  if (command.print_config) {
    std::cout << to_toml(config);
    return;
  }
  const FolderLock lock(RunFolder(config.model.output).lock(), config.model.output,
                        FolderLock::Kind::alone, FolderLock::File::removed);
  resumed.reset();  // one checkpoint in memory at a time
  resumed = find_resumed();  // again, since nobody else changes the folder any more
  if (resumed) config = resumed->config;
  if (resumed && resumed->is_finished) {
    log_info("the run in {} is finished; --iterations +N makes it longer by N steps",
             resumed->source.string());
    return;
  }
  const RunFolder folder(config.model.output);
  if (!(resumed ? resumed->goes_on_in_place() : !command.resume.empty()))
    check_is_free(folder, command.force);
  set_thread_count(config.train.threads);
  const std::unique_ptr<Backend> backend = make_backend(config.train.device);
  log_info("training on {} with {} threads", backend->name(), thread_count());
  if (!resumed) reconstruct_bare_photos(config, folder, !command.quiet);
  Scene scene = load(config.dataset, !command.quiet);
  log_forecast(config, scene, *backend);
  if (resumed) adopt_scene(*resumed, scene);

  std::optional<Trainer> made;  // before the folder, so that a scene that cannot be trained leaves none
  if (!resumed) made.emplace(scene, config, *backend);
  std::optional<TrainViewer> viewer;  // takes its port before the run's folder is touched
  if (command.viewer.is_wanted) viewer.emplace(folder, scene, config, command.viewer);
  CheckpointFolder checkpoints(folder.checkpoints(), config, SceneRecord(scene));
  const auto keep_start = [&] {
    checkpoints.save(resumed->checkpoint.state.progress, resumed->checkpoint.state.model);
  };
  if (resumed && resumed->is_extended) keep_start();  // before the old results are moved aside
  start_folder(command, resumed, folder, config, scene);
  if (resumed && !resumed->goes_on_in_place()) keep_start();
  const RowsBefore rows = rows_before(resumed, Schedule(config, 1).steps());
  if (resumed) {
    log_info("the run goes on after step {}", resumed->checkpoint.state.progress.step);
    made.emplace(scene, config, *backend, std::move(resumed->checkpoint.state));
  }
  Trainer& trainer = *made;
  trainer.keep_checkpoints_in(checkpoints);
  const int steps = trainer.schedule().steps();
  ProgressObserver progress(steps, !command.quiet);
  SaveObserver saver(folder);
  EvaluationObserver evaluations(progress);
  MetricsObserver metrics(folder, evaluations, rows.metrics);
  ProfileObserver profile(folder, evaluations, rows.profile);
  for (Observer* observer :
       std::initializer_list<Observer*>{&saver, &evaluations, &metrics, &progress, &profile})
    trainer.add_observer(*observer);
  if (viewer) trainer.add_observer(viewer->observer(metrics, evaluations));

  run_until_done(trainer, folder);
  progress.clear();
  const int last = trainer.step();
  if (last < steps) end_stopped_run(trainer, folder);
  save_model(folder, last, trainer);
  Results results = results_of(trainer);
  evaluate_run(trainer, folder, last, results);
  metrics.finish(last, trainer, results.test);
  write_text(folder.per_view(), per_view_json(results));
  const std::string results_text = results_json(results);
  write_final_report(folder, results_text);
  write_text(folder.results(), results_text);  // the last: it says that the run is finished
  checkpoints.keep_only_newest();
  export_run(command, trainer, folder);  // when nothing can be lost any more
  if (!command.quiet) print_summary(results, folder);
  if (viewer) viewer->end(trainer, results.test);
}

}  // namespace

void add_train(CLI::App& program) {
  CLI::App& verb =
      *program.add_subcommand("train", "Train Gaussians on photos with a COLMAP model");
  const auto command = std::make_shared<TrainCommand>();
  CommandLine& line = *command;
  add_dataset_options(verb, line, "scene,-s,--source-path,-d,--data");
  add_setting(verb, line, "--eval", "dataset.eval", "Scene");
  add_setting(verb, line, "--refine-cameras", "dataset.refine_cameras", "Scene");
  add_setting(verb, line, "--exposure", "dataset.exposure", "Scene");
  add_setting(verb, line, "-o,--output,-m,--model-path", "model.output", "Output");
  verb.add_option("--resume", command->resume,
                  "go on with the run in OUT, if there is one (auto), or with that of a folder or "
                  "checkpoint")
      ->type_name("auto|PATH")
      ->expected(0, 1)
      ->default_str("auto")
      ->group("Output");
  add_setting(verb, line, "--checkpoint-every", "train.checkpoint_every", "Output");
  verb.add_flag("--force", command->force, "move a run that is there already to OUT.bak-N first")
      ->group("Output");
  verb.add_option("--export", command->exports,
                  "write the last model in these formats, too: " + format_names())
      ->delimiter(',')
      ->type_name("FORMAT,...")
      ->group("Output");
  add_viewer_options(verb, command->viewer);
  add_setting(verb, line, "--save-steps,--save-iterations", "train.save_steps", "Output",
              "save the PLY after these steps, besides the last");
  add_setting(verb, line, "--test-steps,--test-iterations,--eval-steps", "train.test_steps",
              "Output", "evaluate the test views after these steps, besides the last");
  add_setting(verb, line, "-i,--iterations,--iter,--max-steps", "train.iterations", "Training",
              "of training, one photo each; the schedule scales with it; +N: N more steps of a "
              "finished run, with --resume");
  add_setting(verb, line, "--steps-scaler", "train.steps_scaler", "Training");
  add_setting(verb, line, "--strategy", "density.strategy", "Training");
  add_setting(verb, line, "--max-gaussians,--max-cap,--cap-max", "density.max_gaussians",
              "Training", "grow to no more than N; auto: to as many as there is memory for");
  add_setting(verb, line, "--seed", "train.seed", "Training");
  add_setting(verb, line, "--deterministic", "train.deterministic", "Training");
  add_render_options(verb, line);
  add_general_options(verb, line);
  verb.add_flag("--print-config", command->print_config,
                "print all settings as TOML, and do nothing")
      ->group("Settings");
  verb.callback([command] {
    command->added_steps = take_added_steps(command->flags);
    if (command->added_steps && command->resume.empty())
      throw UsageError("--iterations +N extends a finished run: name it with --resume");
    train(*command);
  });
}

}  // namespace gs
