// SPDX-License-Identifier: Apache-2.0
// A run as it goes on, for those who watch: figures that are known anyway, and from time to time a snapshot of the model.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "gs_app/observers/train_observers.h"
#include "gs_app/view/look_budget.h"
#include "gs_app/view/view_server.h"

namespace gs {

/// Add it as the last observer. Training pays for a copy of the model to the host where LookBudget allows one, and for no wait
/// besides; a thread of low priority makes the file of it, one at a time.
class LiveView final : public ViewSource, public Observer {
 public:
  /// The scene outlives it.
  LiveView(std::string title, const Scene& scene, const Config& config,
           LookBudget::Clock clock = LookBudget::steady_seconds);
  ~LiveView() override;

  /// Where loss and PSNR come from; before the first step. They outlive the run.
  void follow(const MetricsObserver& metrics, const EvaluationObserver& evaluations);
  void after_step(int step, Trainer& trainer) override;
  void after_rollback(int step, Trainer& trainer) override;
  void after_run(Trainer& trainer) override;
  /// The run is over, and `model`, where one is given, is shown from now on. Returns when it is ready.
  void end(std::optional<GaussianModel> model, const Evaluation& test);

  const ViewScene& scene() const override { return scene_; }
  nlohmann::ordered_json mode_and_model() override;
  nlohmann::ordered_json state() override;
  HttpAnswer model() override;

  /// Copies of the model that were taken so far.
  int looks() const { return looks_; }

 private:
  struct Snapshot {
    std::shared_ptr<const std::string> file;  // its bytes
    std::size_t gaussians = 0;
    int sh_degree = 0;
    bool antialiased = false;
  };
  struct Figures {
    int step = 0, steps = 0;
    std::optional<double> loss, psnr;
    std::size_t gaussians = 0;
    double seconds = 0;
    bool is_done = false, is_stopped = false;
    std::string message;
    int message_until = 0;  // step
  };

  void take_figures(int step, Trainer& trainer);
  void hand_over(GaussianModel model);
  void encode_all();
  Snapshot encode(const GaussianModel& model) const;

  ViewScene scene_;
  LookBudget budget_;
  const MetricsObserver* metrics_ = nullptr;
  const EvaluationObserver* evaluations_ = nullptr;
  int looks_ = 0;

  std::mutex mutex_;
  std::condition_variable changed_;
  Figures figures_;
  Snapshot newest_;
  int version_ = 0;
  std::optional<GaussianModel> waiting_;  // for the encoder
  bool is_encoding_ = false, quit_ = false;
  std::thread encoder_;
};

}  // namespace gs
