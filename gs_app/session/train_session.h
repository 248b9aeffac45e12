// SPDX-License-Identifier: Apache-2.0
// One training run from beginning to end: settings in, a run's folder out. `gemsplat train` and
// gemsplat.train(output=...) are programs around it.
#pragma once

#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "gs_app/checkpoints/checkpoint_folder.h"
#include "gs_app/checkpoints/resume.h"
#include "gs_app/observers/profile_observer.h"
#include "gs_app/observers/train_observers.h"
#include "gs_app/run/process_place.h"
#include "gs_app/run/results.h"
#include "gs_app/run/run_folder.h"
#include "gs_app/run/wall_clock.h"
#include "gs_app/session/last_checkpoint.h"
#include "gs_app/session/session_hooks.h"
#include "gs_core/error.h"
#include "gs_core/scene.h"
#include "gs_core/system/files/output_lock.h"
#include "gs_eval/lpips/lpips.h"
#include "gs_train/backend.h"
#include "gs_train/loop/trainer.h"

namespace gs {

/// The request to a session.
struct TrainRequest {
  /// Applies the settings over a start, and validates the result. The start is the defaults for a
  /// new run, and the run's own config for one that is resumed.
  SettingsOver settings;
  std::string resume;   // "auto", a run's folder or a checkpoint; empty: a new run
  int added_steps = 0;  // for a finished run, with `resume`
  bool force = false;   // move a run that the output folder holds to FOLDER.bak-N
  std::vector<std::string> exports = {};  // names of formats for the trained model, besides PLY
  bool writes_report = true;              // report.html
  bool shows_progress = true;             // the progress line of the steps, on standard error
  bool stops_on_signal = true;   // SIGINT and SIGTERM end the run early, with its state saved
  const Scene* scene = nullptr;  // null: load dataset.source. Outlives the session.
  // One of several processes that run the same session (docs/method/several_gpus.md#processes).
  // Process 0 writes the run's folder, and the others write nothing.
  std::optional<ProcessPlace> place = {};
  WallClock::Clock::time_point begin = WallClock::Clock::now();  // of the command, for results.json
};

/// How run() ended.
enum class SessionEnd {
  finished,
  stopped,      // early: model and checkpoint are saved, and `resume` goes on
  nothing_left  // the run to resume was finished before, with all exports asked for
};

/// Make it, call run() once. While the session lives it holds the lock of the output folder, and
/// backend, scene, trainer and observers stay as they are at the end of the run.
///
/// The parts of a run, in this order:
///   find the run to resume, lock the folder, read the network of LPIPS, reconstruct bare photos,
///   load the scene, make the trainer, write the run's description, train, save the model, evaluate,
///   write results and report, export
/// The backend is made in the background while the scene is loaded, and before photos are
/// reconstructed. The last checkpoint and the last model are written in the background, too.
/// Results come after them.
class TrainSession {
 public:
  /// Throws UsageError or Error where a format of `exports` cannot be written.
  TrainSession(TrainRequest request, SessionHooks& hooks);
  ~TrainSession();

  /// Throws Error: what went wrong, what is saved, and how to go on.
  SessionEnd run();

  // After run(), unless nothing was left to do:
  const RunFolder& folder() const { return *folder_; }
  Trainer& trainer() { return *trainer_; }
  const Results& results() const { return results_; }
  Lpips* lpips() { return lpips_.get(); }  // null where it is not measured

 private:
  struct Observers;

  SessionEnd follow();

  // Before the first step.
  void choose_run(CheckpointPart part);
  Config config_of_new_run() const;
  std::vector<std::filesystem::path> inputs() const;
  void lock_folder();
  void check_output() const;
  void clear_folder_for_photos();
  void start_backend();
  void take_backend();
  void get_scene();
  void describe_scene();
  void record_scene();
  void make_new_trainer();
  void start_folder();
  void make_resumed_trainer();
  void save_resumed_state();
  void save_start();
  void add_observers();
  bool is_finished() const { return resumed_ && resumed_->is_finished; }
  bool goes_on_in_place() const { return resumed_ && resumed_->goes_on_in_place(); }

  // From there on.
  void train();
  void save_last_model();
  void write_last_model();
  void wait_for_files();
  void end_part(const char* part);
  void finish();
  SessionEnd end_finished_run();
  void guarded(const char* what, const std::function<void()>& f);
  void naming_what_is_kept(const std::function<void()>& f);
  std::string what_is_kept(ExitCode code) const;
  void add_what_is_kept(std::string& text, ExitCode code) const;

  TrainRequest request_;
  WallClock clock_;
  SessionHooks& hooks_;
  Config config_;
  std::optional<ResumedRun> resumed_;
  std::optional<RunFolder> folder_;
  std::optional<OutputLock> lock_;
  std::unique_ptr<Lpips> lpips_;  // null where it is not measured
  std::unique_ptr<Backend> backend_;
  std::future<void> backend_is_made_;  // by a thread, until take_backend()
  std::optional<Scene> loaded_scene_;
  const Scene* scene_ = nullptr;  // the loaded one, or that of the request
  bool has_made_scene_ = false;   // in the run's folder, from bare photos
  std::string scene_hash_;        // of its files before they were read
  SceneRecord record_;
  std::optional<CheckpointFolder> checkpoints_;
  std::optional<LastCheckpoint> last_checkpoint_;
  std::optional<RunProgress> start_;  // of a run that starts from a model
  std::optional<Trainer> trainer_;
  std::unique_ptr<Observers> observers_;
  Results results_;
  std::optional<GaussianModel> last_model_;  // of a finished run
  std::future<void> model_file_;             // where it is written
};

}  // namespace gs
