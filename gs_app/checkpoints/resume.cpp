// SPDX-License-Identifier: Apache-2.0
#include "gs_app/checkpoints/resume.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "data_loaders/reconstruct/photo_folder.h"
#include "gs_app/checkpoints/checkpoint_folder.h"
#include "gs_core/config/config_diff.h"
#include "gs_core/config/scene_settings.h"
#include "gs_core/error.h"
#include "gs_core/system/files/access.h"
#include "gs_core/system/files/atomic_file.h"
#include "gs_core/system/files/move_aside.h"
#include "gs_core/system/log.h"
#include "gs_model/formats/formats.h"
#include "gs_train/photometric/photometric_model.h"
#include "gs_train/schedule.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

void check_kept_settings(const Config& ours, const Config& now, const fs::path& folder) {
  std::string differing;
  for (const SettingChange& change : config_diff(ours, now))
    if (!change.may_change_on_resume())
      differing += fmt::format("{}{} = {} (now {})", differing.empty() ? "" : ", ", change.key,
                               change.a, change.b);
  if (!differing.empty())
    throw UsageError(
        fmt::format("the run in {} was trained with {}, which a resumed run cannot change: leave "
                    "the new value out, or start a new run in another folder (-o)",
                    folder.string(), differing));
}

// The schedule stays that of the run. Where another length is asked for, the difference becomes
// extra steps at the end, so that the steps already done were right.
void keep_schedule(const Config& ours, Config& now, int steps_done) {
  const int schedule = Schedule(ours, 1).steps_without_extra();
  if (now.train.iterations != ours.train.iterations) {
    const double asked = std::round(double(now.train.iterations) * now.train.steps_scaler);
    if (asked < schedule)
      throw UsageError(fmt::format(
          "--iterations {} is less than the {} steps that this run is scheduled for; leave it out",
          now.train.iterations, schedule));
    now.train.extra_steps = int(asked) - schedule;
    now.train.iterations = ours.train.iterations;
  }
  if (schedule + now.train.extra_steps < steps_done)
    throw UsageError(
        fmt::format("the run has done {} steps already; give a larger number", steps_done));
}

// `--iterations +N` makes a finished run longer. A run whose extension is not complete yet goes on
// with that first.
void add_steps(ResumedRun& run, int added) {
  if (added == 0) return;
  if (run.is_finished) {
    run.config.train.extra_steps += added;
    run.is_finished = false;
    run.is_extended = true;
  } else if (run.config.train.extra_steps == 0) {
    throw UsageError(fmt::format(
        "--iterations +{} extends a finished run, and the one in {} is at step {}: finish it with "
        "--resume alone first",
        added, run.source.string(), run.checkpoint.state.progress.step));
  } else {
    run.finishes_extension = true;
  }
}

// A model has neither Adam's moments nor a step to go on from.
void refuse_model(const fs::path& file) {
  if (!find_format(file)) return;
  throw UsageError(
      fmt::format("{} is a model, not a checkpoint, so a run cannot go on from it; give --resume a "
                  "run's folder, or start a new run from the model with --from {} -o OUT",
                  file.string(), file.string()));
}

// The checkpoint and the folder of its run.
std::optional<ResumedRun> find_checkpoint(const SettingsOver& settings, const std::string& where,
                                          CheckpointPart part) {
  const bool is_auto = where == "auto";
  const fs::path named = is_auto ? fs::path(settings({}).model.output) : fs::path(where);
  if (named.empty())
    throw UsageError(
        "there is no run to resume; give its folder with -o OUT, or with --resume OUT");
  if (!is_auto && !fs::exists(named))
    throw UsageError("there is no run to resume at " + named.string() + "; check the path");
  ResumedRun run;
  if (fs::is_regular_file(named)) {
    refuse_model(named);
    run.checkpoint = read_checkpoint(named, part);
    run.source = fs::absolute(named).lexically_normal().parent_path().parent_path();
    return run;
  }
  run.source = named;
  std::optional<Checkpoint> found = newest_checkpoint(RunFolder(named).checkpoints(), part);
  if (!found && is_auto) return std::nullopt;
  if (!found)
    throw Error("there is no checkpoint to resume from in " +
                RunFolder(named).checkpoints().string() +
                "; start a new run in another folder (-o), or here with --force");
  run.checkpoint = std::move(*found);
  return run;
}

bool same_rows(const Mat3<float>& a, const Mat3<float>& b) {
  return a.row0 == b.row0 && a.row1 == b.row1 && a.row2 == b.row2;
}

bool is_same(const ViewRecord& a, const ViewRecord& b) {
  const Camera &x = a.camera, &y = b.camera;
  return x.lens == y.lens && x.fx == y.fx && x.fy == y.fy && x.cx == y.cx && x.cy == y.cy &&
         same_rows(x.cam_from_world_rotation, y.cam_from_world_rotation) &&
         x.cam_from_world_translation == y.cam_from_world_translation && a.exposure == b.exposure;
}

// Folders that cannot be listed now are left out.
void remove_leftovers_below(const fs::path& root) {
  remove_leftovers(root);
  try {
    std::error_code ignored;
    for (const fs::path& entry : entries_of(root))
      if (fs::symlink_status(entry, ignored).type() == fs::file_type::directory)
        remove_leftovers_below(entry);
  } catch (const AccessError&) {
  }
}

// A kill before the first file is whole leaves empty folders, which do not count.
bool holds_a_file(const fs::path& path) {
  if (!fs::is_directory(path)) return fs::exists(path);
  for (const auto& entry : fs::recursive_directory_iterator(path))
    if (!entry.is_directory()) return true;
  return false;
}

void set_aside(const fs::path& path) {
  if (!fs::exists(path)) return;
  log_info("{} is kept as {}", path.filename().string(), move_aside(path).filename().string());
}

// Whether the run in the folder could be resumed with these settings, if it had a checkpoint: it has
// another number of threads, another device, or the like.
bool could_go_on(const RunFolder& folder, const Config& config) {
  Config written;
  try {
    load_config(written, folder.config());
  } catch (const AccessError&) {
    throw;
  } catch (const Error&) {  // there is none, or it is damaged
    return false;
  }
  const std::vector<SettingChange> changes = config_diff(written, config);
  return std::ranges::all_of(changes, &SettingChange::may_change_on_resume);
}

}  // namespace

bool ResumedRun::goes_on_in_place() const {
  std::error_code ignored;
  return fs::weakly_canonical(source, ignored) ==
         fs::weakly_canonical(config.model.output, ignored);
}

int extract_added_steps(std::vector<std::string>& settings) {
  constexpr std::string_view kStart = "train.iterations=+";
  int added = 0;
  std::erase_if(settings, [&](const std::string& flag) {
    if (!flag.starts_with(kStart)) return false;
    const char *first = flag.data() + kStart.size(), *last = flag.data() + flag.size();
    const auto [end, failure] = std::from_chars(first, last, added);
    if (failure != std::errc() || end != last || added <= 0)
      throw UsageError("--iterations " + flag.substr(kStart.size() - 1) +
                       " cannot be used: it must be a count of steps to add, such as +10000");
    return true;
  });
  return added;
}

std::optional<ResumedRun> find_resumed_run(const SettingsOver& settings, const std::string& where,
                                           int added_steps, CheckpointPart part) {
  std::optional<ResumedRun> run = find_checkpoint(settings, where, part);
  if (!run) {
    if (added_steps)
      throw UsageError(
          fmt::format("--iterations +{} extends a finished run, and there is none", added_steps));
    return std::nullopt;
  }
  const Config& ours = run->checkpoint.config;
  RunProgress& progress = run->checkpoint.state.progress;
  Config start = ours;
  start.model.output = run->source.string();
  run->config = settled_as_in(ours, settings(start));
  DatasetConfig& dataset = run->config.dataset;
  if (!dataset.source.empty()) {  // else: a scene made of arrays
    // The scene that the run has made of bare photos is in the checkpoint's config.
    if (holds_only_photos(dataset.source)) dataset.source = ours.dataset.source;
    dataset.source = fs::absolute(dataset.source).lexically_normal().string();
  }
  for (std::string* file : {&run->config.model.start_from, &dataset.photo_list})
    if (!file->empty()) *file = fs::absolute(*file).lexically_normal().string();
  // The photos have chosen when the run began.
  std::string& photometric = run->config.photometric.model;
  if (photometric == kAutoPhotometricModel) photometric = ours.photometric.model;
  check_kept_settings(ours, run->config, run->source);
  // `+N` counts from the run's own length, whatever length a preset beside it has.
  if (added_steps) run->config.train.iterations = ours.train.iterations;
  keep_schedule(ours, run->config, progress.step);
  if (run->config.density.max_gaussians != ours.density.max_gaussians) progress.growth_cap = 0;
  run->is_finished = progress.step == Schedule(run->config, 1).steps() &&
                     fs::exists(RunFolder(run->source).results());
  add_steps(*run, added_steps);
  return run;
}

bool has_solved_views(const ResumedRun& run) {
  return run.config.dataset.refine_cameras || run.config.dataset.exposure;
}

void check_same_scene(const ResumedRun& run, const SceneRecord& here, const std::string& source) {
  const SceneRecord& ours = run.checkpoint.scene;
  const bool has_same_photos = run.config.dataset.images == run.checkpoint.config.dataset.images;
  const auto refuse = [&](const std::string& what) {
    throw Error(
        fmt::format("{} is not the scene that the run in {} was trained on: {}; name that scene, "
                    "or start a new run in another folder (-o)",
                    source, run.source.string(), what));
  };
  if (here.views.size() != ours.views.size())
    refuse(fmt::format("it has {} views, not {}", here.views.size(), ours.views.size()));
  for (std::size_t i = 0; i < here.views.size(); ++i) {
    const ViewRecord &now = here.views[i], &was = ours.views[i];
    if (now.name != was.name || now.is_test != was.is_test)
      refuse(fmt::format("view {} is in the place of {}", now.name, was.name));
    if (now.camera.width != was.camera.width || now.camera.height != was.camera.height)
      refuse(fmt::format("{} has {}x{} pixels, not {}x{}", now.name, now.camera.width,
                         now.camera.height, was.camera.width, was.camera.height));
    if (!has_solved_views(run) && !is_same(now, was))
      refuse("the camera of " + now.name + " differs");
    if (run.config.model.dynamic && now.camera.time != was.camera.time)  // else it is not recorded
      refuse(fmt::format("{} has the time {}, not {}", now.name, now.camera.time, was.camera.time));
    if (has_same_photos && now.photo && was.photo && now.photo != was.photo)
      refuse("the file of " + now.name + " is another photo than it was");
  }
}

void restore_scene(const ResumedRun& run, Scene& scene) {
  const SceneRecord& ours = run.checkpoint.scene;
  const std::size_t trained = scene.train_views.size();
  for (std::size_t i = 0; i < ours.views.size(); ++i) {
    View& view = i < trained ? scene.train_views[i] : scene.test_views[i - trained];
    view.camera = ours.views[i].camera;
    view.exposure = ours.views[i].exposure;
  }
  scene.extent = ours.extent;
  scene.world_offset = ours.world_offset;
}

void move_trained_run_aside(const RunFolder& folder, OutputLock& lock,
                            const std::vector<fs::path>& needed) {
  for (const fs::path& made :
       {folder.root() / "point_cloud", folder.results(), folder.checkpoints()})
    if (holds_a_file(made)) return move_run_aside(folder, lock, needed);
}

void prepare_fresh_start(const RunFolder& folder, const Config& config, OutputLock& lock,
                         const std::vector<fs::path>& needed, bool holds_made_scene) {
  remove_leftovers_below(folder.root());
  move_trained_run_aside(folder, lock, needed);
  if (holds_text(folder.config(), to_toml(config))) return;
  // A scene that was made is trained on now; settings.toml and the log are an experiment's.
  if (holds_made_scene || could_go_on(folder, config))
    set_aside(folder.config());
  else
    move_run_aside(folder, lock, needed);
}

void prepare_resumed_folder(const RunFolder& folder, const ResumedRun& run) {
  remove_leftovers_below(folder.root());
  const int step = run.checkpoint.state.progress.step;
  for (const CheckpointPath& checkpoint : checkpoints_in(folder.checkpoints()))
    if (checkpoint.step > step) set_aside(checkpoint.file);
  if (step < Schedule(run.config, 1).steps())
    for (const fs::path& of_fewer :
         {folder.results(), folder.per_view(), folder.comparison(), folder.report()})
      set_aside(of_fewer);
  if (!holds_text(folder.config(), to_toml(run.config))) set_aside(folder.config());
}

}  // namespace gs
