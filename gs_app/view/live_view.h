// SPDX-License-Identifier: Apache-2.0
// A training run in the viewer: its progress, and from time to time a snapshot of its model.
#pragma once

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "gs_app/observers/train_observers.h"
#include "gs_app/view/run_control.h"
#include "gs_app/view/snapshot_budget.h"
#include "gs_app/view/view_server.h"
#include "gs_core/system/text/json.h"

namespace gs {

/// Add it as the last observer of the run. When SnapshotBudget allows it, the training thread
/// copies the model to the host; it waits for nothing else. A thread of low priority turns each
/// copy into a file, one at a time. While no page polls /state.json, nothing is copied.
class LiveView final : public ViewSource, public Observer {
 public:
  /// The scene outlives it.
  LiveView(std::string title, const Scene& scene, const Config& config,
           SnapshotBudget::Clock clock = SnapshotBudget::steady_seconds);
  ~LiveView() override;

  /// Sets the sources of loss and PSNR, which must outlive the run. Call it before the first step.
  void follow(const MetricsObserver& metrics, const EvaluationObserver& evaluations);
  void after_step(int step, Trainer& trainer) override;
  void after_rollback(int step, Trainer& trainer) override;
  void after_run(Trainer& trainer) override;
  /// Lets the page control the run. `control` outlives this.
  void let_control(RunControl& control) { control_ = &control; }
  /// Shows the model as it is now, whatever the copy costs: of a run that waits.
  void show_now(Trainer& trainer);
  /// A sentence for the page, which stays.
  void say(std::string sentence);
  /// Ends the run; from now on `model` is shown, if one is given. Returns when its file is ready.
  void end(std::optional<GaussianModel> model, const Evaluation& test);

  const ViewScene& scene() const override { return scene_; }
  Json mode_and_model() override;
  Json state(int after_step) override;
  HttpAnswer model() override;
  HttpAnswer control(const HttpRequest& request) override;

  /// Number of copies of the model that were made so far.
  int copies() const { return copies_; }

 private:
  struct Snapshot {
    std::shared_ptr<const std::string> file;  // the bytes of the file
    std::size_t gaussians = 0;
    int sh_degree = 0;
    bool antialiased = false;
  };
  struct Progress {
    int step = 0, steps = 0;
    std::optional<double> psnr;
    std::vector<LoggedLoss> losses;  // of every row of metrics.csv
    std::size_t gaussians = 0;
    double seconds = 0;
    bool is_done = false, is_stopped = false;
    std::string message;
    int message_until = 0;  // the step up to which the message is shown
  };

  void take_snapshot(Trainer& trainer);
  void take_poses(Trainer& trainer);
  void update_progress(int step, Trainer& trainer);
  void update_losses();  // mutex_ is held
  void pass_to_encoder(GaussianModel model);
  void encode_all();
  Snapshot encode(const GaussianModel& model) const;

  ViewScene scene_;
  SnapshotBudget budget_;
  const MetricsObserver* metrics_ = nullptr;
  const EvaluationObserver* evaluations_ = nullptr;
  std::atomic<RunControl*> control_ = nullptr;
  int copies_ = 0;

  std::mutex mutex_;
  std::condition_variable changed_;
  Progress progress_;
  std::vector<Camera> refined_;  // of training views at the last copy, where poses are refined
  Snapshot newest_;
  int version_ = 0;
  std::optional<GaussianModel> waiting_;  // the copy that the encoder takes next
  bool is_encoding_ = false, quit_ = false;
  std::thread encoder_;
};

}  // namespace gs
